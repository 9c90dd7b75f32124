"""Processors: threads that tick activities, one at a time, as a pure schedule says."""

from tca_behaviours.activities.processing.baton import Baton as Baton
from tca_behaviours.activities.processing.virtual_baton import VirtualBaton as VirtualBaton
