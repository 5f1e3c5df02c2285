"""Instantaneous centres of rotation of arrays of states."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from . import _sidehill
from ._arrays import broadcast
from ._sidehill import Vehicle


def icr(
    vehicle: Vehicle,
    roll_rad: npt.ArrayLike,
    pitch_rad: npt.ArrayLike,
    v_left_m_s: npt.ArrayLike,
    v_right_m_s: npt.ArrayLike,
) -> dict[str, npt.NDArray[np.float64]]:
    """Returns ICRs and body velocity by ICRIK, equations (5)-(10) and (4) of the paper, and by ICRHK.

    vehicle: whose parameters are used.
    roll_rad, pitch_rad: right side down and nose up positive, rad, within +-pi/2; numbers or arrays.
    v_left_m_s, v_right_m_s: effective tread speeds V_l and V_r, after c_l and c_r, m/s, within +-100; numbers or arrays.

    The result has arrays of the shape to which numpy broadcasts these: `x_icr_left_m`, `x_icr_right_m`, `y_icr_m` in the body frame (x
    right, y forward), `v_x_m_s`, `v_y_m_s`, `omega_z_rad_s`; and the same with `icrhk_` before the name, by the
    model for level ground.

    Raises ValueError with the argument's name where it is not a number, not finite, out of range or of a shape that
    does not fit.
    """
    named = {
        "roll_rad": roll_rad,
        "pitch_rad": pitch_rad,
        "v_left_m_s": v_left_m_s,
        "v_right_m_s": v_right_m_s,
    }
    shape, flat = broadcast(named)
    columns = _sidehill.icr(vehicle, *flat)
    return {name: column.reshape(shape) for name, column in columns.items()}
