"""Whether there is what properties, kills and suspensions name: of a wrong name everything would hold, without a word.

Modules are known from the beginning. Messages are named that a module handles and named that scripts come to use in
some run, such as monitors: so what is missing is known for certain when all runs are.
"""

from collections.abc import Collection, Iterable, Iterator

from tca_explorer.errors import ScenarioError
from tca_explorer.scenario.argument_checks import nearest
from tca_explorer.scenario.scenario import Scenario
from tca_properties import Property


def check_module_names(scenario: Scenario, properties: Iterable[Property]) -> None:
    """Raise ScenarioError for a property of a module that the scenario has not."""
    for one in properties:
        for named in one.named:
            if named.module and named.module.partition("#")[0] not in scenario.modules:
                raise ScenarioError(f"property '{one}': scenario '{scenario.title}' has no module '{named.module}'; "
                                    f"{nearest(named.module, scenario.modules)}")  # fmt: skip


def check_message_names(scenario: Scenario, properties: Iterable[Property], used: Collection[str]) -> None:
    """Raise ScenarioError for the name of a message that is not among all that are handled or *used*."""
    others = [("may_kill()", scenario.may_be_killed), ("may_suspend()", scenario.may_be_suspended)]
    missing = [f"property '{one}': {words}" for one in properties for words in unknown_names(one, used)]
    missing += [f"{call}: {_missing(name, used)}" for call, names in others for name in names if name not in used]
    if missing:
        raise ScenarioError(f"it can't be judged: {missing[0]}")


def unknown_names(one: Property, used: Collection[str]) -> Iterator[str]:
    """What is wrong with the names of messages in a property, in words."""
    names = dict.fromkeys(named.message for named in one.named if named.message)
    return (_missing(name, used) for name in names if name not in used)


def _missing(name: str, used: Collection[str]) -> str:
    return f"there is no message '{name}': no module handles it, and no script uses it; {nearest(name, used)}"
