"""The generated parts about Python names: coroutines, failures, conditions, predicates."""

import inspect
import re

import tca_module
from dev.site.markdown import cell, code, flowing, sentence, table
from dev.site.sources import members, packages, text_of
from tca_tools.properties import predicates
from tca_tools.properties.predicates import MessageState
from tca_wire.points import END_ACHIEVING, END_HANDLING, END_PLANNING, describe_moments
from tca_wire.rules import (
    CONDITIONS,
    DELIVERED,
    FAILURE,
    KILLED,
    REPLIED,
    RETURNED,
    SENT,
    SUCCESS,
    TapRule,
)
from tca_wire.vocabulary import MessageClass

BLOCKING = {"AsyncSender": "Sender", "AsyncTaskRef": "TaskRef", "AsyncTask": "Task"}
"""Class of coroutines -> the class of the blocking methods."""
ADVICE = re.compile(r"^(?P<word>Cause|Remedy): (?P<text>.+?)(?=\n\n|\Z)", re.MULTILINE | re.DOTALL)
"""A paragraph of a docstring about the cause of an error, or about what to do."""
OLDER_NAMES = re.compile(r" \((?:TCA|TCM|TDL)[^)]*\)")
"""Such as "(TCA 7.7: GetVar)"."""
EVENTS = {
    SENT: "central has accepted it",
    DELIVERED: "its handler starts",
    RETURNED: "its handler has returned or failed",
    REPLIED: "its sender has the reply",
    SUCCESS: "its handler has returned without a failure",
    FAILURE: "its handler has failed",
    KILLED: "it is killed",
}

DONE = {END_HANDLING: "handled", END_PLANNING: "planned", END_ACHIEVING: "achieved"}


def coroutines() -> str:
    """Return a table of the coroutines that have the arguments of a blocking method."""
    rows = []
    for name, blocking in {**BLOCKING, "AsyncClient": "Client"}.items():
        for call, one in vars(getattr(tca_module, name)).items():
            method = getattr(getattr(tca_module, blocking), call, None)
            doc = inspect.getdoc(one) if inspect.isfunction(one) else None
            if not call.startswith("_") and doc and doc == inspect.getdoc(method):
                link = f"[`{blocking}.{call}`][tca_module.{blocking}.{call}]"
                rows.append((code(f"{name}.{call}"), link, first_sentence(doc)))
    return table(("coroutine or stream", "as", "meaning"), rows)


def first_sentence(text: str) -> str:
    """Return the first sentence of a docstring, without the names of older systems."""
    start = OLDER_NAMES.sub("", flowing(text.partition("\n\n")[0]))
    return re.split(r"(?<=\.) ", start)[0]


def advice(text: str) -> tuple[str, str, str]:
    """Return the meaning, the cause and the remedy of a docstring's error or failure."""
    found = {one["word"]: flowing(one["text"]) for one in ADVICE.finditer(text)}
    return (
        flowing(text.partition("\n\n")[0]),
        sentence(found.get("Cause", "")),
        sentence(found.get("Remedy", "")),
    )


def failures() -> str:
    """Return a table of the built-in failures."""
    rows = [
        (code(name), *advice(text_of(one)))
        for name, one in sorted(members("tca_wire.messages.built_in").items())
    ]
    return table(("failure", "meaning", "usual cause", "what to do"), rows)


def errors() -> str:
    """Return a table of the errors, with causes and remedies."""
    rows = [
        (f"[`{name}`][tca_module.{name}]", *advice(text_of(packages()[error_path(name)])))
        for name in sorted(error_names())
    ]
    return table(("error", "meaning", "usual cause", "what to do"), rows)


def error_names() -> list[str]:
    """Return the names of the public errors."""
    return [
        name
        for name in tca_module.__all__
        if inspect.isclass(kind := getattr(tca_module, name))
        and issubclass(kind, Exception)
        and name != "FailureRaised"
    ]


def error_path(name: str) -> str:
    """Return the place of an error's class."""
    kind = getattr(tca_module, name)
    return f"{kind.__module__}.{name}"


def conditions() -> str:
    """Return a table of the conditions of wiretaps."""
    rows = [
        (code(one.name), sent_when(rule), tappable(rule), held(rule))
        for one, rule in CONDITIONS.items()
    ]
    return table(("condition", "the listener is sent", "for", "what waits for the listener"), rows)


def sent_when(rule: TapRule) -> str:
    """Return when the listener of a condition is sent, in words."""
    if rule.held_moment:
        return f"before the {moment(rule.held_moment)}"
    return f"when {EVENTS[rule.at]}" if rule.at in EVENTS else f"at the {moment(rule.at)}"


def moment(bits: int) -> str:
    """Return a moment in words, such as "end of planning"."""
    edge, _, interval = describe_moments(bits)[0].partition(" ")
    return f"{edge} of {interval}"


def tappable(rule: TapRule) -> str:
    """Return the classes of messages that have a condition, in words."""
    if rule.classes == frozenset(MessageClass):
        return "all messages"
    if not all(one.is_task for one in rule.classes):
        return "queries, multi-queries"
    if any(one.is_monitor for one in rule.classes):
        return "tasks, monitors"
    return "goals" if all(one.is_goal for one in rule.classes) else "tasks"


def held(rule: TapRule) -> str:
    """Return what a condition holds, in words."""
    if rule.held_moment and rule.holds_until:
        return f"the {moment(rule.held_moment)}, until the listener is {DONE[rule.holds_until]}"
    if rule.held_moment:
        return f"the {moment(rule.held_moment)}, until the listener is {DONE[rule.held_moment]}"
    return "the end of the task, until the listener has ended" if rule.is_child else "nothing"


def states() -> str:
    """Return a table of the predicates of the explorer and of checks."""
    found = {name: one for name, one in vars(predicates).items() if isinstance(one, MessageState)}
    rows = [(code(name), cell(one.meaning)) for name, one in sorted(found.items())]
    return table(("predicate", "meaning"), rows)
