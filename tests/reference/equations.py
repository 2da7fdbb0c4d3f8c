"""The paper's Eq. 3-14 in plain loops over one frame, written from the text, but that Eq. 10 counts log depths.

A joint is (x, y, confidence) in pixels, an image is a list of rows. Where the text leaves a choice, the comment
says which was taken: it is the same as in ``faithful`` mode.
"""

import math

NAN = float("nan")


def visible(joints):
    return [j for j in range(5) if joints[j][2] > 0.5]  # Sec. 9


def shot_size(joints_ref, size_ref, joints_S, size_S):
    best, choice = -1.0, None
    shown = visible(joints_ref)
    for j in shown:
        for k in shown:
            for axis in (0, 1):
                if j != k:
                    d = abs(joints_ref[j][axis] - joints_ref[k][axis]) / size_ref[axis]  # Eq. 4
                    if d > best:
                        best, choice = d, (axis, j, k)
    if choice is None:
        return NAN
    axis, a, b = choice
    d_S = abs(joints_S[a][axis] - joints_S[b][axis]) / size_S[axis]  # Eq. 5
    return abs(best - d_S)  # Eq. 3


def framing(joints_ref, size_ref, joints_S, size_S):
    shown = visible(joints_ref)
    if not shown:
        return NAN
    total = 0.0
    for axis in (0, 1):  # relative to the frame, as Eq. 4; the text does not say (row 5)
        mean_ref = sum(joints_ref[j][axis] / size_ref[axis] for j in shown) / len(shown)  # Eq. 7
        mean_S = sum(joints_S[j][axis] / size_S[axis] for j in shown) / len(shown)
        total += (mean_ref - mean_S) ** 2
    return math.sqrt(total)  # Eq. 6


def representative_depth(depths, pixels):
    """Eq. 10 with a Gaussian kernel and Scott's bandwidth over log depth, on a fine grid.

    The text has it over depth, whose mode moves where a network gives inverse depth; it names no bandwidth (row
    8). Scott's rule counts as if the frame had 160x90 instead of ``pixels`` pixels.
    """
    values = [math.log(d) for d in depths]
    count = len(values)
    if count == 0:
        return NAN
    mean = sum(values) / count
    if max(values) - min(values) < 1e-9:
        return math.exp(mean)
    nominal = count / pixels * 160 * 90
    scott = math.sqrt(sum((v - mean) ** 2 for v in values) / count) * nominal**-0.2
    bandwidth = max(scott, 0.01 * (max(values) - min(values)))
    best, mode = -1.0, NAN
    for step in range(1001):
        place = min(values) + (max(values) - min(values)) * step / 1000
        density = sum(math.exp(-0.5 * ((v - place) / bandwidth) ** 2) for v in values)
        if density > best:
            best, mode = density, place
    return math.exp(mode)


def filmic_space(depth_ref, layers_ref, depth_S, layers_S):
    """``layers``: masks of foreground, character, background. A ratio without its layer is skipped (row 7)."""

    def representative(depth, mask):
        rows, columns = len(depth), len(depth[0])
        inside = [depth[y][x] for y in range(rows) for x in range(columns) if mask[y][x]]
        return representative_depth(inside, rows * columns)

    f_ref, c_ref, b_ref = (representative(depth_ref, mask) for mask in layers_ref)
    f_S, c_S, b_S = (representative(depth_S, mask) for mask in layers_S)
    terms = []
    for other_ref, other_S in ((b_ref, b_S), (f_ref, f_S)):
        term = abs(math.log(other_ref / c_ref) - math.log(other_S / c_S))  # Eq. 8, 9
        if not math.isnan(term):
            terms.append(term)
    return sum(terms) if terms else NAN


def camera_movement(flow_ref, layers_ref, flow_S, layers_S):
    """``flow``: (x, y) of each pixel [px]. Over the pixels both count to the layer (row 11)."""
    errors = []
    for mask_ref, mask_S in zip(layers_ref, layers_S):
        total, count = 0.0, 0
        for y, row in enumerate(mask_ref):
            for x, inside in enumerate(row):
                if inside and mask_S[y][x]:
                    (ax, ay), (bx, by) = flow_ref[y][x], flow_S[y][x]
                    total += math.sqrt((ax - bx) ** 2 + (ay - by) ** 2)
                    count += 1
        if count:
            errors.append(total / count)  # Eq. 12
    return sum(errors) / len(errors) if errors else NAN  # Eq. 11; 1/3 where all layers are there


def camera_angle(angles_ref, angles_S):
    return sum(abs(a_S - a_ref) for a_ref, a_S in zip(angles_ref, angles_S))  # Eq. 13, 14; in rad, not wrapped
