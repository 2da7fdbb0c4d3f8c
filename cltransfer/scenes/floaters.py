"""Floaters: Gaussians that hang in the air by themselves, as reconstructions leave them where few views looked.

What is solid is made of Gaussians that touch, hundreds of them at least. A floater touches nothing, or a few of its
kind. A search takes it for foreground, stands close behind it, and ends where the scene itself has nothing.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from torch import Tensor

from ..computer.array_type import Array
from ..computer.memory import require_free
from ..computer.threads import thread_count
from ..errors import InputError
from ..storage.files import atomic, cache_dir, into_cache
from . import Scene
from .columns import RESERVE, needed_bytes
from .simplify import subset
from .splats import Splats

NEIGHBOURS = 8  # nearest Gaussians that one is held against
REACH = 1.0  # two touch where they are no farther apart than this times the sum of their largest standard deviations
MEMBERS = 32  # fewer than these, each in touch with another of them, are no thing
THIN = 0.05  # of a scene, at most, can be floaters: where more would be, it has holes instead, and stays as it is
BLOCK = 2**18  # Gaussians whose neighbours are looked up at once
KEPT = 50_000  # Gaussians from which the answer is kept in the cache: a quarter of a second
PEAK = 480  # bytes that a Gaussian takes meanwhile; 471 were measured with a million that all touch


def floaters(splats: Splats) -> Tensor:
    """Which Gaussians touch no solid thing, (N,) bool.

    The subject's (label above 0.5) never count as floaters, and none does in a scene so thin that its own surfaces
    come apart. It does not change with the scene's unit. About 5 microseconds a Gaussian; of a large scene the answer
    is kept in the cache, by content.

    Raises:
        InputError: what the cache holds is damaged.
    """
    small = _known(splats) if len(splats) >= KEPT else _members(splats) < MEMBERS
    alone = torch.from_numpy(small) & (splats.label.cpu() <= 0.5)
    return alone if int(alone.sum()) <= THIN * len(splats) else torch.zeros_like(alone)


def without_floaters(scene: Scene) -> Scene:
    """The scene less its :func:`floaters`; a scene that is not made of splats as it is.

    Raises:
        InputError: what the cache holds is damaged.
        ResourceError: there is not enough memory to look for them.
    """
    if not isinstance(scene.geometry, Splats):
        return scene
    count = len(scene.geometry)
    require_free(PEAK * count, scene.name, f"the neighbours of {count} Gaussians", "set floaters=keep")
    alone = floaters(scene.geometry)
    if not bool(alone.any()):
        return scene
    held = needed_bytes(count, scene.geometry.degree) - RESERVE  # a second scene, which is drawn beside the whole one
    require_free(held, scene.name, f"{count} Gaussians without those that float", "set floaters=keep")
    return replace(scene, geometry=subset(scene.geometry, ~alone))


def _known(splats: Splats) -> Array:
    """Which Gaussians are of a thing too small, (N,) bool, from the cache or put there."""
    path, count = _cached(splats), len(splats)
    if not path.is_file():
        small = _members(splats) < MEMBERS
        with into_cache(path, "the next run looks for floaters anew"), atomic(path) as temporary:
            temporary.write_bytes(np.packbits(small).tobytes())
        return small
    if path.stat().st_size != -(-count // 8):
        raise InputError(path, "", f"expected {-(-count // 8)} bytes, got {path.stat().st_size}", "delete it")
    return np.unpackbits(np.fromfile(path, np.uint8), count=count).astype(bool)


def _cached(splats: Splats) -> Path:
    told = hashlib.sha256(f"places {NEIGHBOURS} {REACH} {MEMBERS}".encode())
    for part in (splats.means, splats.scales):
        told.update(f" {part.dtype} ".encode())
        told.update(part.detach().cpu().contiguous().numpy().tobytes())
    return cache_dir() / "floaters" / f"{told.hexdigest()[:32]}.bits"


def _members(splats: Splats) -> Array:
    """Of how many Gaussians the thing consists that each one belongs to, (N,)."""
    means = splats.means.detach().cpu().double().numpy()
    width = splats.scales.detach().cpu().double().numpy().max(1, initial=0)
    if len(means) <= NEIGHBOURS:
        return np.full(len(means), MEMBERS)
    first, place = _places(means)
    widest = np.zeros(len(first))
    np.maximum.at(widest, place, width)
    means, width = means[first], widest  # the others are let go
    thing = _things(means, width)[place]
    return np.bincount(thing)[thing]


def _places(means: Array) -> tuple[Array, Array]:
    """The first Gaussian of each place (P,), and at which of these places each one is (N,): in touch with all there.

    A tree cannot part points that coincide, and would look through all of them for each of them.
    """
    order = np.lexsort(means.T)
    apart = np.ones(len(means), bool)
    apart[1:] = (means[order[1:]] != means[order[:-1]]).any(1)
    first = np.empty(len(means), np.int64)  # at the place of each
    first[order] = order[apart][np.cumsum(apart) - 1]
    is_first = first == np.arange(len(means))
    return np.flatnonzero(is_first), (np.cumsum(is_first, dtype=np.int32) - 1)[first]


def _things(means: Array, width: Array) -> Array:
    """To which thing each of ``means`` (P, 3) belongs, no two of which coincide, (P,)."""
    count = len(means)
    tree, touching = KDTree(means), list[Array]()
    nearest = range(1, min(count, NEIGHBOURS + 1) + 1)
    for start in range(0, count, BLOCK):  # all at once takes more memory
        distance, other = tree.query(means[start : start + BLOCK], k=nearest, workers=thread_count())
        own = np.arange(start, start + len(other))[:, None]
        touch = (distance <= REACH * (width[own] + width[other])) & (other != own)
        touching.append(np.stack([np.broadcast_to(own, other.shape)[touch], other[touch]]).astype(np.int32))
    pairs = np.concatenate(touching, axis=1)
    links = coo_array((np.ones(pairs.shape[1], bool), (pairs[0], pairs[1])), shape=(count, count))
    _, thing = connected_components(links, directed=False)
    return np.asarray(thing)
