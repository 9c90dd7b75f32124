"""Properties of runs: conditions that must be true always, never or eventually.

The explorer and ``tca check`` use the same properties. Properties of cases concern whole runs, so
only ``tca check`` accepts them.
"""

from tca_tools.properties.algebra import Property as Property
from tca_tools.properties.algebra import always as always
from tca_tools.properties.algebra import at_most as at_most
from tca_tools.properties.algebra import at_most_in_all as at_most_in_all
from tca_tools.properties.algebra import before as before
from tca_tools.properties.algebra import eventually as eventually
from tca_tools.properties.algebra import never as never
from tca_tools.properties.algebra import never_stuck as never_stuck
from tca_tools.properties.algebra import within as within
from tca_tools.properties.cases import CasesProperty as CasesProperty
from tca_tools.properties.cases import Counted as Counted
from tca_tools.properties.cases import in_all_cases as in_all_cases
from tca_tools.properties.cases import in_at_least as in_at_least
from tca_tools.properties.language import property_from as property_from
from tca_tools.properties.predicates import achieved as achieved
from tca_tools.properties.predicates import begun as begun
from tca_tools.properties.predicates import being_achieved as being_achieved
from tca_tools.properties.predicates import failed as failed
from tca_tools.properties.predicates import fired as fired
from tca_tools.properties.predicates import handled as handled
from tca_tools.properties.predicates import handled_by as handled_by
from tca_tools.properties.predicates import killed as killed
from tca_tools.properties.predicates import planned as planned
from tca_tools.properties.predicates import planned_ahead as planned_ahead
from tca_tools.properties.predicates import queued as queued
from tca_tools.properties.predicates import recovering as recovering
from tca_tools.properties.predicates import resolved as resolved
from tca_tools.properties.predicates import retried as retried
from tca_tools.properties.predicates import sent as sent
from tca_tools.properties.predicates import suspended as suspended
from tca_tools.properties.world import BadProperty as BadProperty
