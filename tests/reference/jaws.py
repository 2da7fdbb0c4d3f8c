"""JAWS' two losses in plain loops over one frame, written from their description and from nothing else.

A joint is (x, y, confidence) in pixels of the maps, a map a list of rows.
"""

import math

NAN = float("nan")


def heat_map(joint, width, height, spread):
    x, y, amount = joint
    return [
        [
            amount * math.exp(-0.5 * ((c + 0.5 - x) ** 2 + (r + 0.5 - y) ** 2) / spread**2)
            for c in range(width)
        ]
        for r in range(height)
    ]  # fmt: skip


def turned(joint, width, height, degrees):
    """The joint in the frame turned about its middle; a Gaussian is round, so its map turns with it."""
    angle = math.radians(degrees)
    x, y = joint[0] - width / 2, joint[1] - height / 2
    along = math.cos(angle) * x + math.sin(angle) * y
    return (along + width / 2, -math.sin(angle) * x + math.cos(angle) * y + height / 2, joint[2])


def e(a, b):
    """Mean over rows and columns of the squared difference of the cumulative sums along x."""
    total, count = 0.0, 0
    for row_a, row_b in zip(a, b):
        sum_a = sum_b = 0.0
        for value_a, value_b in zip(row_a, row_b):
            sum_a += value_a
            sum_b += value_b
            total += (sum_a - sum_b) ** 2
            count += 1
    return total / count


def E(a, b, width, height, spread):
    total = 0.0
    for degrees in (0, 45, 90, 135):
        maps = [heat_map(turned(joint, width, height, degrees), width, height, spread) for joint in (a, b)]
        total += e(*maps)
    return total


def kappas(joints, width, height, spread, temperature):
    """Range of each map's softmax, so that they add up to the number of joints."""
    ranges = []
    for joint in joints:
        values = [v for row in heat_map(joint, width, height, spread) for v in row]
        powers = [math.exp(temperature * (v - max(values))) for v in values]
        ranges.append((max(powers) - min(powers)) / sum(powers))
    return [r * len(joints) / sum(ranges) for r in ranges] if sum(ranges) > 0 else [NAN] * len(joints)


def pose(reference, rendered, width, height, spread, temperature, quirks):
    count = len(reference)
    kappa = kappas(reference, width, height, spread, temperature)
    own = sum(kappa[c] * E(reference[c], rendered[c], width, height, spread) for c in range(count)) / count
    pairs = 0.0
    for c0 in range(count):
        for c1 in range(count):
            if c1 < c0:
                factor = kappa[count - 1] if quirks else kappa[c0]
                d_ref = factor * E(reference[c0], reference[c1], width, height, spread)
                d_S = factor * E(rendered[c0], rendered[c1], width, height, spread)
                pairs += (d_ref - d_S) ** 2
    return 0.7 * own + 0.3 * pairs / count**2


def flow(reference, size_ref, rendered, size_S, quirks, angular):
    """Mean squared difference of two flows on one grid, and their mean angle; a flow is a list of (u, v)."""
    squares, angles = [], []
    for (u_ref, v_ref), (u_S, v_S) in zip(reference, rendered):
        (width_ref, height_ref), (width_S, height_S) = size_ref, size_S
        across_ref, across_S = (width_ref, width_S) if quirks else (height_ref, height_S)
        a = (u_ref * 224 / across_ref, v_ref * 224 / height_ref, 1.0)
        b = (u_S * 224 / across_S, v_S * 224 / height_S, 1.0)
        squares += [(a[0] - b[0]) ** 2, (a[1] - b[1]) ** 2]
        cosine = sum(p * q for p, q in zip(a, b)) / math.sqrt(sum(p * p for p in a) * sum(q * q for q in b))
        angles.append(math.acos(max(-1.0, min(1.0, cosine))) / math.pi)
    return sum(squares) / len(squares) + angular * sum(angles) / len(angles)
