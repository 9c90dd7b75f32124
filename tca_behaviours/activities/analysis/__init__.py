"""Whether processors keep their periods, and which allocation needs the fewest of them."""

from tca_behaviours.activities.analysis.bounds import is_hyperbolic as is_hyperbolic
from tca_behaviours.activities.analysis.bounds import liu_layland as liu_layland
from tca_behaviours.activities.analysis.policies import automatic as automatic
from tca_behaviours.activities.analysis.policies import one_each as one_each
from tca_behaviours.activities.analysis.policies import one_for_all as one_for_all
from tca_behaviours.activities.analysis.response_times import Demand as Demand
from tca_behaviours.activities.analysis.response_times import response_bounds as response_bounds
from tca_behaviours.activities.analysis.response_times import utilisation as utilisation
