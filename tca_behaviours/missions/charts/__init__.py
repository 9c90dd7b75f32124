"""State machines of mission tasks."""

from tca_behaviours.missions.charts.machine import Concurrence as Concurrence
from tca_behaviours.missions.charts.machine import Sequence as Sequence
from tca_behaviours.missions.charts.machine import StateMachine as StateMachine
from tca_behaviours.missions.charts.states import MachineState as MachineState
from tca_behaviours.statecharts.states import UnsoundMachine as UnsoundMachine
