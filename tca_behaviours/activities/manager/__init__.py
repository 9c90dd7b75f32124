"""Publishes an application as variables of central, and carries out commands that change it."""

from tca_behaviours.activities.manager.manager import Manager as Manager
from tca_behaviours.activities.manager.messages import REFUSED as REFUSED
from tca_behaviours.activities.manager.messages import ActivityMove as ActivityMove
from tca_behaviours.activities.manager.messages import ActivityPeriod as ActivityPeriod
from tca_behaviours.activities.manager.messages import ApplicationMessages as ApplicationMessages
from tca_behaviours.activities.manager.messages import Control as Control
from tca_behaviours.activities.manager.messages import ControlField as ControlField
from tca_behaviours.activities.manager.messages import ProcessorPriority as ProcessorPriority
