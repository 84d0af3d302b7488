"""Tasks on the workers of a Dask or Ray cluster, which see the same files under the same names."""

from maglev_offline.cluster.connect import BACKENDS as BACKENDS
from maglev_offline.cluster.connect import Backend as Backend
from maglev_offline.cluster.connect import workers as workers
