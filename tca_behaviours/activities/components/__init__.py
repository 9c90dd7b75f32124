"""Components: typed ports, private data, and statecharts with orthogonal regions."""

from tca_behaviours.activities.components.component import Component as Component
from tca_behaviours.activities.components.component import initialise as initialise
from tca_behaviours.activities.components.ports import InputPort as InputPort
from tca_behaviours.activities.components.ports import OutputPort as OutputPort
from tca_behaviours.activities.components.ports import connect as connect
from tca_behaviours.activities.components.region import Region as Region
from tca_behaviours.activities.components.region import RegionChange as RegionChange
from tca_behaviours.activities.components.states import RegionState as RegionState
from tca_behaviours.statecharts.states import UnsoundMachine as UnsoundMachine
