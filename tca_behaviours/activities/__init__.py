"""Components whose statecharts run activities on periodic threads, allocated at run time."""

from tca_behaviours.activities.analysis import automatic as automatic
from tca_behaviours.activities.analysis import one_each as one_each
from tca_behaviours.activities.analysis import one_for_all as one_for_all
from tca_behaviours.activities.application import POLICIES as POLICIES
from tca_behaviours.activities.application import Application as Application
from tca_behaviours.activities.processing import VirtualBaton as VirtualBaton
