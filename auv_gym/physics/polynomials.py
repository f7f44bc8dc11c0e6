"""The terms of a hull's hydrodynamic polynomials, and the parameter groups that hold their coefficients.

A force is a sum of coefficients times products of the velocities through the water, the form in which captive model
tests are reduced (Gertler and Hagen 1967) and which the published coefficient sets use. `uv` is u v, `v_v` is v |v|.
They hold for u > 0; astern, u times an axis's own velocity (sway `uv`, heave `uw`, roll `up`, pitch `uq`, yaw `ur`) is
replaced by |u| times it, so that damping still damps.
"""

from __future__ import annotations

from dataclasses import make_dataclass

from auv_gym.param import param

RATES = "pqr"
TERMS = (
    *"uvwpqr",
    *(f"{a}_{a}" for a in "uvwpqr"),
    "vv", "ww", "pp", "qq", "rr",
    "uv", "uw", "up", "uq", "ur",
    "vw", "vp", "vq", "vr", "wp", "wq", "wr",
    "pq", "pr", "qr",
)  # fmt: skip
# Further variables of an unknown force, in the search for a missing term.
ENVIRONMENT_TERMS = ("depth", "sin_heading", "cos_heading")


def words(term: str) -> str:
    """A term as a formula: `uv` is u v and `v_v` is v |v|."""
    if term in ENVIRONMENT_TERMS:
        return term.replace("_", " ")
    return f"{term[0]} |{term[0]}|" if "_" in term else " ".join(term)


def unit(term: str, moment: bool) -> str:
    """The unit of a term's coefficient in a force (or moment): kg m^k or kg m^k/s, angles counting as numbers."""
    if term in ENVIRONMENT_TERMS:
        return {"depth": "N" if moment else "N/m"}.get(term, "N m" if moment else "N")
    symbols = term.replace("_", "")
    power = sum(symbol in RATES for symbol in symbols) + moment - (len(symbols) == 2)
    base = "kg" if power == 0 else "kg/m" if power == -1 else "kg m" if power == 1 else f"kg m^{power}"
    return base if len(symbols) == 2 else f"{base}/s"


def _group(name: str, moment: bool, terms: tuple[str, ...], doc: str) -> type:
    kind = "moment" if moment else "force"
    fields = [(t, float, param(0.0, unit(t, moment), f"{{}} {kind} from {words(t)}")) for t in terms]
    namespace = {"as_array": True, "__doc__": doc, "__module__": __name__}
    return make_dataclass(name, fields, frozen=True, namespace=namespace)


ForceTerms = _group("ForceTerms", False, TERMS, "Coefficients of a body force over TERMS, N.")
MomentTerms = _group("MomentTerms", True, TERMS, "Coefficients of a body moment over TERMS, N m.")
DiscoveredForce = _group(
    "DiscoveredForce", False, (*TERMS, *ENVIRONMENT_TERMS), "Coefficients of a body force found in data, N."
)
DiscoveredMoment = _group(
    "DiscoveredMoment", True, (*TERMS, *ENVIRONMENT_TERMS), "Coefficients of a body moment found in data, N m."
)
