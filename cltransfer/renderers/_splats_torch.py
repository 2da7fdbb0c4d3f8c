"""Gaussian splats in plain torch: the rule the kernels are tested against, and differentiable.

Readable first; several ten times slower than the kernels.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..camera import Camera
from ..scenes.splats import Splats
from .kernels.splat_composite import MAX_ALPHA, MIN_COVER, MIN_TRANSMITTANCE
from .kernels.splat_cull import LOW_PASS, TANGENT_MARGIN, Settings
from .kernels.splat_pack import MIN_ALPHA
from .kernels.splat_project import MAX_DETERMINANT, TILE


def render_one(splats: Splats, camera: Camera, settings: Settings) -> dict[str, Tensor]:
    """All buffers of one camera, differentiable in the camera and the Gaussians (median depth in depth only).

    image (3, H, W) in [0, 1]; alpha, label (H, W) in [0, 1]; depth (median) and expected_depth (H, W), scene units, NaN
    where undefined.
    """
    ellipses = _project(splats, camera.w2c[0], camera.K[0], camera.size, settings)
    width, height = camera.size
    rows = []
    for top in range(0, height, TILE):
        lefts = range(0, width, TILE)
        row = [_tile(ellipses, (left, top, min(left + TILE, width), min(top + TILE, height))) for left in lefts]
        rows.append(torch.cat(row, dim=2))
    planes = torch.cat(rows, dim=1)  # (7, H, W)
    alpha = planes[3]
    mean = torch.where(alpha >= MIN_COVER, planes[5] / alpha.clamp(min=MIN_COVER), torch.nan)
    depth = torch.where(planes[6] > 0, planes[6], torch.nan)
    return {
        "image": planes[:3].clamp(max=1),
        "alpha": alpha,
        "label": planes[4],
        "depth": depth,
        "expected_depth": mean,
    }


def _project(splats: Splats, w2c: Tensor, K: Tensor, size: tuple[int, int], settings: Settings) -> dict[str, Tensor]:
    """Ellipses of what is in front of the camera, nearest first: center, conic, peak, reach, depth, features."""
    w2c, K = w2c.to(splats.means), K.to(splats.means)
    camera = splats.means @ w2c[:3, :3].T + w2c[:3, 3]
    index = torch.nonzero((camera[:, 2] > settings.near) & (splats.opacity > MIN_ALPHA))[:, 0]
    index = index[camera[index, 2].argsort(stable=True)]
    focal, middle = K.diagonal()[:2], K[:2, 2]
    covariance = _image_covariance(splats.covariances()[index], camera[index], w2c, K, size)
    sharp = _determinant(covariance)
    covariance = covariance + LOW_PASS * torch.eye(2, dtype=covariance.dtype, device=covariance.device)
    determinant = _determinant(covariance)
    there = (determinant > 0) & (determinant < MAX_DETERMINANT)  # of long needles float32 leaves no ellipse
    index, covariance, sharp, determinant = index[there], covariance[there], sharp[there], determinant[there]
    camera, depth = camera[index], camera[index, 2]
    peak = splats.opacity[index] * faded(depth, settings)
    if settings.antialiased:  # keeps the energy of a splat the low-pass widens (Mip-Splatting)
        peak = peak * (sharp / determinant).clamp(2.5e-5, 1).sqrt()
    spread = 2 * (peak.detach() / MIN_ALPHA).clamp(min=1).log()
    color = seen_colors(splats, index, -w2c[:3, :3].T @ w2c[:3, 3])
    signs = covariance.new_tensor([[1, -1], [-1, 1]])
    return {
        "center": focal * camera[:, :2] / depth[:, None] + middle,
        "conic": signs * covariance.flip(1, 2) / determinant[:, None, None],  # the inverse
        "peak": peak,
        "reach": (spread[:, None] * covariance.detach().diagonal(dim1=1, dim2=2)).sqrt(),
        "depth": depth,
        "features": torch.cat([color, torch.ones_like(depth)[:, None], splats.label[index, None], depth[:, None]], 1),
    }


def _determinant(matrices: Tensor) -> Tensor:
    """Of symmetric (M, 2, 2), as the kernels work it out, (M,)."""
    return matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1].square()


def _image_covariance(covariances: Tensor, camera: Tensor, w2c: Tensor, K: Tensor, size: tuple[int, int]) -> Tensor:
    """J W S W^T J^T, (M, 2, 2) [px^2]: the projection linearised at each centre (Zwicker et al. 2002)."""
    focal, middle, depth = K.diagonal()[:2], K[:2, 2], camera[:, 2:]
    extent = K.new_tensor(size)
    margin = TANGENT_MARGIN * extent / focal
    tangent = (camera[:, :2] / depth).clamp(-middle / focal - margin, (extent - middle) / focal + margin)
    scale = torch.diag_embed(focal / depth)
    jacobian = torch.cat([scale, -(focal * tangent / depth)[..., None]], dim=2) @ w2c[:3, :3]
    return jacobian @ covariances @ jacobian.transpose(1, 2)


def _tile(ellipses: dict[str, Tensor], box: tuple[int, int, int, int]) -> Tensor:
    """Red, green, blue, alpha, label, depth sum, median depth of the pixels in ``box``, (7, h, w)."""
    center, reach = ellipses["center"].detach(), ellipses["reach"]
    low, high = center.new_tensor(box[:2]), center.new_tensor(box[2:])
    near = ((center + reach > low) & (center - reach < high)).all(1)
    conic, peak, depth = ellipses["conic"][near], ellipses["peak"][near], ellipses["depth"][near]
    x, y = (torch.arange(box[axis], box[axis + 2], dtype=low.dtype, device=low.device) + 0.5 for axis in (0, 1))
    pixels = torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1).reshape(-1, 1, 2)
    offset = pixels - ellipses["center"][near]  # (P, M, 2)
    power = torch.einsum("pmi,mij,pmj->pm", offset, conic, offset) / 2
    alpha = (peak * torch.exp(-power)).clamp(max=MAX_ALPHA)
    alpha = torch.where(alpha >= MIN_ALPHA, alpha, 0)
    after = torch.cumprod(1 - alpha, dim=1)
    before = torch.cat([torch.ones_like(after[:, :1]), after[:, :-1]], dim=1)
    weight = torch.where(after >= MIN_TRANSMITTANCE, before * alpha, 0)  # the splat that ends a pixel is not added
    sums = weight @ ellipses["features"][near]
    median = (((before > 0.5) & (after <= 0.5)) * depth).sum(1, keepdim=True)
    return torch.cat([sums, median], dim=1).T.reshape(7, box[3] - box[1], box[2] - box[0])


def faded(depth: Tensor, settings: Settings) -> Tensor:
    """Share of its opacity that a Gaussian at ``depth`` [scene units] keeps behind the near plane, in [0, 1]."""
    return ((depth - settings.near) / max(settings.near_fade, 1e-6)).clamp(0, 1)


def seen_colors(splats: Splats, index: Tensor, eye: Tensor) -> Tensor:
    """Colours >= 0 of the Gaussians ``index`` (M,), (M, 3), each seen from ``eye`` (3,) or (M, 3)."""
    direction = torch.nn.functional.normalize(splats.means[index] - eye, dim=-1)
    basis = sh_basis(direction, splats.degree)
    return ((basis[..., None] * splats.sh[index]).sum(1) + 0.5).clamp(min=0)


def sh_basis(direction: Tensor, degree: int) -> Tensor:
    """Real spherical harmonics up to ``degree`` in 0..3 of unit vectors (N, 3), (N, (degree + 1)^2).

    >>> sh_basis(torch.tensor([[0.0, 0.0, 1.0]]), 1)
    tensor([[0.2821, -0.0000, 0.4886, -0.0000]])
    """
    x, y, z = direction.unbind(-1)
    bands = [
        [torch.full_like(x, 0.28209479177387814)],
        [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x],
        [
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (3 * z * z - 1),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (x * x - y * y),
        ],
        [
            -0.5900435899266435 * y * (3 * x * x - y * y),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (5 * z * z - 1),
            0.3731763325901154 * z * (5 * z * z - 3),
            -0.4570457994644658 * x * (5 * z * z - 1),
            1.445305721320277 * z * (x * x - y * y),
            -0.5900435899266435 * x * (x * x - 3 * y * y),
        ],
    ]
    return torch.stack([value for band in bands[: degree + 1] for value in band], dim=-1)
