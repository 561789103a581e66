"""Frames, state and units of the whole project. Every other module cites this page.

Units
    SI, radians, seconds, float64. A name carries its unit unless that unit is SI and obvious (`pixel_std`, `rate_rpm`).
Frames
    ``i`` inertial: the left camera at the first epoch, unless the poses of a moving camera (the inspector) are given.
    ``c`` camera: x right, y down, z forward.  ``g`` geometric: rigidly on the body, landmarks live in it.
    ``b`` body: principal axes at the centre of mass. It is a result, never a state.
Maps
    ``R_xy`` and ``q_xy`` map coordinates in frame y to coordinates in frame x; ``T_xy = (R_xy, t_xy)``: p_x = R_xy p_y + t_xy.
Quaternions
    Hamilton product, scalar last ``[x, y, z, w]`` (as SciPy, ROS and TUM). ``q_ig`` maps g to i; R(q (x) p) = R(q) R(p).
Attitude error
    4 x MRP, on the body side: q = q_ref (x) dq(a). A small ``a`` is a rotation vector in rad. The plain MRP is tan(angle/4) n,
    so ``a = 4 tan(angle/4) n`` (Tweddle 2013, Eq. 2.34).
State blocks (error dimension; defined in `spinfilters.models.state_blocks`)
    ``t`` 3  origin of g in i, m                 ``a`` 3  attitude error of q_ig, rad
    ``v`` 3  velocity of the centre of mass, i, m/s   ``w`` 3  body rate, g axes, rad/s
    ``c`` 3  centre of mass in g, m              ``s`` 5  mass distribution (see `spinfilters.core.mass_distribution`)
    Letters of blocks have nothing to do with those of frames: axes on the body are those of g in every block. The attitude has two
    letters: its mean is ``q`` (4) in expressions, its error ``a`` (3) in layouts and covariances.
    Optional, each where a data set or a setting asks for it:
    ``d`` 1  aerodynamic drag, 1/rad             ``l`` 1  drag linear in the rate, 1/s
    ``b`` 3  bias of the gyro, g axes, rad/s     ``k`` 1  scale error of the gyro, 1
    ``f`` 3  constant acceleration, i, m/s^2     ``h`` 3  angular momentum of a flywheel inside, g axes, unit of J times rad/s
    ``m`` 3  constant torque on the body as its angular acceleration J^-1 tau, g axes, rad/s^2
    The centre of mass moves as r = t + R_ig c, r' = v, v' = f; the rate as w' = J^-1 ((J w + h) x w) - d |w| w - l w + m, J in g
    axes, without the terms of blocks that a state lacks.
    A data set that shows rotation only (a gyro) uses a, w, s and the optional blocks d, l, b, k, h, m; the origin of i is then the
    centre of mass.
Noise
    Names of continuous densities end in ``_psd``, with units such as (rad/s^2)^2/Hz; those of discrete covariances end in ``_cov``.
"""

from typing import Any, Final

RPM: Final[float] = 0.10471975511965977
"""One revolution per minute in rad/s (2 pi / 60)."""
PerRun = Any
"""A number; of many runs that are evaluated together an array of them, (r,)."""
