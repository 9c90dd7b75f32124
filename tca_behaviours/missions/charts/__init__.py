"""State machines of mission tasks."""

from tca_behaviours.missions.charts.machine import Concurrence as Concurrence
from tca_behaviours.missions.charts.machine import Sequence as Sequence
from tca_behaviours.missions.charts.machine import StateMachine as StateMachine
from tca_behaviours.missions.charts.running import MachineEnd as MachineEnd
from tca_behaviours.missions.charts.states import MachineState as MachineState
from tca_behaviours.missions.charts.user_data import FromData as FromData
from tca_behaviours.missions.charts.user_data import UnknownUserData as UnknownUserData
from tca_behaviours.missions.charts.user_data import UserData as UserData
from tca_behaviours.missions.charts.user_data import state as state
from tca_behaviours.statecharts.states import UnsoundMachine as UnsoundMachine
