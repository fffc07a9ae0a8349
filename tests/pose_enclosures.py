"""Poses in ball arithmetic, by other equations than the package's: position and unit quaternion.

|p + R(q) b_i - A_i|^2 = l_i^2 for six legs and |q|^2 = 1, where R(q) b is
(w^2 - v.v) b + 2 (v.b) v + 2 w v x b.
"""

from flint import arb, arb_mat, ctx

BITS = 200


def turned(q, b):
    w, v = q[0], q[1:]
    vv = sum((x * x for x in v), arb(0))
    vb = sum((x * y for x, y in zip(v, b, strict=True)), arb(0))
    cross = [v[1] * b[2] - v[2] * b[1], v[2] * b[0] - v[0] * b[2], v[0] * b[1] - v[1] * b[0]]
    return [(w * w - vv) * b[k] + 2 * vb * v[k] + 2 * w * cross[k] for k in range(3)]


def turned_slopes(q, b):
    """Derivatives of `turned` with respect to q, [row][k]."""
    units = [[arb(int(j == k)) for j in range(4)] for k in range(4)]
    columns = []
    for unit in units:
        both = turned([x + y for x, y in zip(q, unit, strict=True)], b)
        pairs = zip(both, turned(q, b), turned(unit, b), strict=True)
        columns.append([x - y - z for x, y, z in pairs])
    return [[column[row] for column in columns] for row in range(3)]


def equations(base, platform, lengths, y):
    """Values (7,) and derivative (7, 7) at y = (p, q)."""
    p, q = y[:3], y[3:]
    values, rows = [], []
    for a, b, length in zip(base, platform, lengths, strict=True):
        arm, slopes = turned(q, b), turned_slopes(q, b)
        leg = [p[k] + arm[k] - a[k] for k in range(3)]
        values.append(sum((x * x for x in leg), arb(0)) - length * length)
        by_q = [2 * sum((leg[r] * slopes[r][k] for r in range(3)), arb(0)) for k in range(4)]
        rows.append([2 * x for x in leg] + by_q)
    values.append(sum((x * x for x in q), arb(-1)))
    rows.append([arb(0)] * 3 + [2 * x for x in q])
    return values, rows


def enclosure(base, platform, lengths, position, quaternion, radius=1e-9):
    """Balls around (p, q) that hold exactly one pose, within radius of that stated; None without proof."""
    before, ctx.prec = ctx.prec, BITS
    try:
        data = [[[arb(x) for x in row] for row in side.tolist()] for side in (base, platform)]
        given = [arb(x) for x in lengths.tolist()]
        y = [arb(x) for x in [*position.tolist(), *quaternion.tolist()]]
        # the box stays where it was stated; a point in it is made better by Newton's method
        for _ in range(6):
            values, rows = equations(*data, given, y)
            change = arb_mat(rows).mid().inv() * arb_mat([[v] for v in values])
            y = [(x - c).mid() for x, c in zip(y, change.entries(), strict=True)]
        centre = [arb(x) for x in [*position.tolist(), *quaternion.tolist()]]
        if not all(abs(x - c) < radius for x, c in zip(y, centre, strict=True)):
            return None
        small = arb(0, 1e-40)
        values, rows = equations(*data, given, y)
        inverse = arb_mat(rows).mid().inv()
        _, wide = equations(*data, given, [x + small for x in y])
        one = arb_mat([[int(j == k) for j in range(7)] for k in range(7)])
        image = (one - inverse * arb_mat(wide)) * arb_mat([[small]] * 7)
        image = image - inverse * arb_mat([[v] for v in values])
        if not all(abs(x) < arb(1e-40) for x in image.entries()):
            return None
        return [x + shift for x, shift in zip(y, image.entries(), strict=True)]
    finally:
        ctx.prec = before
