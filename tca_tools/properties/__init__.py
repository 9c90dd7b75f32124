"""Properties of runs: what must always, never or at last be true. The explorer and ``tca check`` ask the same, but for
properties of cases, which are of whole runs: these are ``tca check``'s.
"""

from tca_tools.properties.algebra import (
    Property,
    always,
    at_most,
    at_most_in_all,
    before,
    eventually,
    never,
    never_stuck,
    within,
)
from tca_tools.properties.cases import CasesProperty, Counted, in_all_cases, in_at_least
from tca_tools.properties.language import property_from
from tca_tools.properties.predicates import (
    achieved,
    begun,
    being_achieved,
    failed,
    fired,
    handled,
    handled_by,
    killed,
    planned,
    planned_ahead,
    queued,
    recovering,
    resolved,
    retried,
    sent,
    suspended,
)
from tca_tools.properties.world import BadProperty

__all__ = [
    "BadProperty",
    "CasesProperty",
    "Counted",
    "Property",
    "achieved",
    "always",
    "at_most",
    "at_most_in_all",
    "before",
    "begun",
    "being_achieved",
    "eventually",
    "failed",
    "fired",
    "handled",
    "handled_by",
    "in_all_cases",
    "in_at_least",
    "killed",
    "never",
    "never_stuck",
    "planned",
    "planned_ahead",
    "property_from",
    "queued",
    "recovering",
    "resolved",
    "retried",
    "sent",
    "suspended",
    "within",
]
