"""A player whose journal is folded as it goes."""

from central.player import Player

from tca_central.events import Effect, Record
from tca_tools.journal.fold import History


class Folding(Player):
    """A player that folds every entry. ``compare`` then checks that the fold and central agree."""

    history: History

    def event(self, event: object) -> list[Effect]:
        effects = super().event(event)
        for effect in effects:
            if isinstance(effect, Record):
                self.history.apply(effect.entry)
        self.compare()
        return effects

    def compare(self) -> None:
        """Raise AssertionError if the fold and central differ."""


class FoldedPlayer(Folding):
    """A player that folds, but neither compares nor checks central's invariants."""

    def __init__(self) -> None:
        super().__init__(check=False)
        self.history = History()
