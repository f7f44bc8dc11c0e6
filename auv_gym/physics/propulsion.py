"""Thrust and torque of a propeller, and its slipstream."""

from math import pi, sqrt

from auv_gym.compiled import compiled

RADPS_PER_RPM = pi / 30.0
# The grid of a thrust table; it is even, so that a cell is found without a search.
ROWS, COLUMNS = 6, 5
VOLTAGE_STEP = 1.0  # V
LOWEST_INFLOW, INFLOW_STEP = -1.5, 0.75  # m/s
VOLTAGES = tuple(VOLTAGE_STEP * i for i in range(ROWS))
INFLOWS = tuple(LOWEST_INFLOW + INFLOW_STEP * j for j in range(COLUMNS))


@compiled
def shaft_law(shaft_speed, u, per_square, per_speed):
    """Thrust (or torque) from shaft speed n in rad/s and speed of advance: per_square n|n| + per_speed |n| u.

    The same as K_T(J) linear in the advance number J = u/(n D).  Source: Fossen 2021, eq. (9.11).
    """
    return per_square * shaft_speed * abs(shaft_speed) + per_speed * abs(shaft_speed) * u


@compiled
def table_thrust(voltage, inflow, table):
    """Thrust, N, from a table over VOLTAGES (rows) and INFLOWS, m/s, bilinear, constant beyond its edges.

    table: (rows * columns,).  Astern, T(-V, u) = -T(V, -u).
    """
    side = 1.0
    if voltage < 0.0:
        side, voltage, inflow = -1.0, -voltage, -inflow
    row = min(max(0.0, voltage / VOLTAGE_STEP), ROWS - 1.0)
    column = min(max(0.0, (inflow - LOWEST_INFLOW) / INFLOW_STEP), COLUMNS - 1.0)
    i, j = min(int(row), ROWS - 2), min(int(column), COLUMNS - 2)
    share, part = row - i, column - j
    at = i * COLUMNS + j
    low = table[at] + part * (table[at + 1] - table[at])
    high = table[at + COLUMNS] + part * (table[at + COLUMNS + 1] - table[at + COLUMNS])
    return side * (low + share * (high - low))


@compiled
def slipstream_speed(shaft_speed, u, pitch, c_t1):
    """The speed u eps that the propeller adds to the flow at the planes, m/s, in the NPS propulsion model.

    eps = -1 + sign(n)/sign(u) (sqrt(C_t + 1) - 1)/(sqrt(C_t1 + 1) - 1), C_t = c_t1 eta|eta|, eta = pitch n/u;
    multiplied by u here, to avoid dividing by it. The formula has no value for C_t < -1 (astern): the root is then
    zero.
    Source: Healey and Lienard 1993, IEEE J. Oceanic Eng. 18(3).
    """
    drive = pitch * shaft_speed
    inner = c_t1 * drive * abs(drive) * (1.0 if u >= 0.0 else -1.0) + u * u
    side = 1.0 if shaft_speed > 0.0 else -1.0 if shaft_speed < 0.0 else 0.0
    return -u + side * (sqrt(max(inner, 0.0)) - abs(u)) / (sqrt(c_t1 + 1.0) - 1.0)
