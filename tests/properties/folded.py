"""A player whose journal is folded as it goes."""

from central.player import Player

from tca_central.events import Effect, Record
from tca_tools.journal.fold import History


class Folding(Player):
    """Folds every entry; ``compare`` then looks whether the fold and central agree."""

    history: History

    def event(self, event: object) -> list[Effect]:
        effects = super().event(event)
        for effect in effects:
            if isinstance(effect, Record):
                self.history.apply(effect.entry)
        self.compare()
        return effects

    def compare(self) -> None:
        """Raises AssertionError where they do not."""


class FoldedPlayer(Folding):
    """Looks at nothing else."""

    def __init__(self) -> None:
        super().__init__(check=False)
        self.history = History()
