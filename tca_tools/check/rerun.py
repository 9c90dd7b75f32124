"""``tca check --rerun``: process a run's inputs with this version's core, and compare the facts."""

from collections.abc import Iterable, Iterator
from itertools import islice, zip_longest

import click

from tca_central.errors import CentralError
from tca_central.shell.replaying import InputReplay, newest_run
from tca_central.shell.written_facts import Difference, WrittenFacts
from tca_tools.journal.journals import Log
from tca_wire.journal.facts import Entry, Fact, kind_of
from tca_wire.text.facts_in_words import Wording
from tca_wire.text.measures import counted
from tca_wire.text.printable import printable

_SHOWN = 5
"""The number of facts shown from each side."""


def rerun(journal: Log) -> tuple[list[str], bool]:
    """Process the inputs of a run again.

    Returns:
        The result in lines, and whether the facts are the same.

    Raises:
        ClickException: The journal has no inputs, or they can't be processed.
    """
    if not journal.path.is_dir():
        raise click.UsageError(
            f"{journal.path}: name the folder of the journal, which also contains its inputs"
        )
    segments = newest_run(journal.path, journal.epoch or "")
    if not segments:
        raise click.ClickException(
            f"{journal.path} has no inputs of this run: central stored none, or they were removed"
        )
    try:
        replay = InputReplay(journal.path, segments, cuts=True, from_first=True)
        image_events = replay.image_events
        facts = WrittenFacts(journal.path, replay.central.epoch, image_events)
        difference = facts.compare(replay.entries(), [])
    except CentralError as error:
        raise click.ClickException(str(error)) from None
    since = f"since the image at entry {image_events}" if image_events else "since the run started"
    inputs = f"{counted(replay.inputs, 'input')} {since}"
    if difference is None:
        return [f"{inputs} lead to the same {_entries(facts.compared)} in this version"], True
    return [f"{inputs}: {_entries(facts.compared)} are the same", "", *_in_words(difference)], False


def _entries(number: int) -> str:
    return f"{number:,} {'entry' if number == 1 else 'entries'}"


def _in_words(difference: Difference) -> Iterator[str]:
    written, given = difference.written, difference.given
    first = written if given is None or written.number < given.number else given
    yield f"FIRST DIFFERENCE at {first.time:.3f} s, entry {first.number}"
    old = written.facts if written.number == first.number else []
    new = given.facts if given is not None and given.number == first.number else []
    pairs = enumerate(zip_longest(old, new))
    same = next((place for place, (one, other) in pairs if one != other), 0)
    yield f"  the first {same} facts are the same" if same else f"  {_cause(first)}"
    yield "  the journal has"
    yield from _facts(old[same:])
    yield "  this version's core gives"
    yield from _facts(new[same:])


def _cause(entry: Entry) -> str:
    if entry.cause is None:
        return "caused by central itself"
    return printable(Wording().cause(entry.cause))


def _facts(facts: Iterable[Fact]) -> Iterator[str]:
    wording, found = Wording(), list(facts)
    for fact in islice(found, _SHOWN):
        yield f"    {kind_of(fact):14} {printable(wording.words(fact))}".rstrip()
    if not found:
        yield "    nothing more"
    elif len(found) > _SHOWN:
        yield f"    ... and {len(found) - _SHOWN} more"
