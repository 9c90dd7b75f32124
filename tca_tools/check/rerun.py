"""``tca check --rerun``: a run's inputs through this version's core, beside the facts that its
journal has.
"""

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

_SHOWN = 5  # facts of each side


def rerun(journal: Log) -> tuple[list[str], bool]:
    """What came of it, in lines, and whether it is as it was. Raises ClickException if it can't be
    done.
    """
    if not journal.path.is_dir():
        raise click.UsageError(
            f"{journal.path}: give the folder of the journal, in which its inputs are, too"
        )
    segments = newest_run(journal.path, journal.epoch or "")
    if not segments:
        raise click.ClickException(
            f"{journal.path} has no inputs of this run: central kept none, or they were removed"
        )
    try:
        replay = InputReplay(journal.path, segments, cuts=True, from_first=True)
        began = replay.began
        facts = WrittenFacts(journal.path, replay.central.epoch, began)
        difference = facts.compare(replay.entries(), [])
    except CentralError as error:
        raise click.ClickException(str(error)) from None
    since = f"since entry {began}, of which there is an image," if began else "since the run began"
    done = f"{counted(replay.inputs, 'input')} {since}"
    if difference is None:
        return [f"{done} lead to the same {_entries(facts.compared)} in this version"], True
    return [f"{done}: {_entries(facts.compared)} are the same", "", *_told(difference)], False


def _entries(number: int) -> str:
    return f"{number:,} {'entry' if number == 1 else 'entries'}"


def _told(difference: Difference) -> Iterator[str]:
    written, given = difference.written, difference.given
    first = written if given is None or written.number < given.number else given
    yield f"FIRST DIFFERENCE at {first.time:.3f} s, entry {first.number}"
    old = written.facts if written.number == first.number else []
    new = given.facts if given is not None and given.number == first.number else []
    same = next(
        (place for place, (one, other) in enumerate(zip_longest(old, new)) if one != other), 0
    )
    yield f"  the first {same} facts are the same" if same else f"  {_cause(first)}"
    yield "  the journal has"
    yield from _facts(old[same:])
    yield "  this version's core gives"
    yield from _facts(new[same:])


def _cause(entry: Entry) -> str:
    return (
        printable(Wording().cause(entry.cause)) if entry.cause is not None else "of central's own"
    )


def _facts(facts: Iterable[Fact]) -> Iterator[str]:
    wording, found = Wording(), list(facts)
    for fact in islice(found, _SHOWN):
        yield f"    {kind_of(fact):14} {printable(wording.words(fact))}".rstrip()
    if not found:
        yield "    nothing more"
    elif len(found) > _SHOWN:
        yield f"    ... and {len(found) - _SHOWN} more"
