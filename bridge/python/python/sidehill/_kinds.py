"""Names of the controllers."""

from __future__ import annotations

from typing import Literal, TypeAlias

Kind: TypeAlias = Literal["icrik-mpc", "icrhk-mpc", "contact-mpc", "diffdrive-mpc", "pure-pursuit"]
"""Name of a controller: the MPCs by the model that they predict with (ICRIK, ICRHK, wheels with friction, differential
drive), and pure pursuit."""
