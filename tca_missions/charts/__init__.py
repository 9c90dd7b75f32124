"""State machines of mission tasks."""

from tca_missions.charts.machine import Concurrence as Concurrence
from tca_missions.charts.machine import Sequence as Sequence
from tca_missions.charts.machine import StateMachine as StateMachine
from tca_missions.charts.states import MachineState as MachineState
from tca_missions.charts.states import UnsoundMachine as UnsoundMachine
