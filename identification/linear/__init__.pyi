from .fit import LinearFit as LinearFit
from .polynomials.armax import Armax as Armax
from .polynomials.arx import Arx as Arx
from .polynomials.els import Els as Els
from .polynomials.orders import OrderSearch as OrderSearch, search_orders as search_orders
from .polynomials.output_error import OutputError as OutputError
from .subspaces.n4sid import N4sid as N4sid
from .subspaces.pbsid import Pbsid as Pbsid
from .uncertainty import (
    pole_intervals as pole_intervals,
    response_band as response_band,
    simulated_band as simulated_band,
)
