"""What is behind the object in a photo: the photo as a camera shows it, with the object taken out."""

import numpy as np
import scipy  # which loads its parts where they are used
from PIL import Image

from fracsim.camera import View
from fracsim.photo.outline import Outline
from fracsim.records import Array
from fracsim.scene.vocab import CENTRE

COARSE = 160
"""Longest edge of the grid on which the hole is filled [px]; what fills it is smooth."""
RIM = 0.012
"""The hole reaches over the outline by this part of the photo's longest edge, where colours are mixed."""
GRAIN = 1.5
"""Scale of the ground's grain that is put onto the fill [px]."""


def backdrop(seen: Outline, size: float, view: View) -> Array:
    """The ground behind an object of largest extent `size` [m] as a camera sees it, (H, W, 3) in [0, 1].

    The photo stands in the plane of the object's centre. Beyond its edges it goes on with their colours.
    """
    ground = filled(seen.photo.rgb / np.float32(255), _hole(seen.mask))
    columns, rows = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    rays = np.stack([(columns - view.cx) / view.fx, (rows - view.cy) / view.fy, np.ones_like(rows)], axis=-1)
    rays = rays @ view.rotation  # to the world
    toward = np.minimum(rays[..., 2], -1e-6)  # a ray that leaves the plane behind sees its far edge
    reach = (CENTRE[2] - view.eye[2]) / toward
    hit = view.eye + reach[..., None] * rays - np.array(CENTRE)
    at = seen.to_photo(hit[..., :2] / size)
    return _sampled(ground, at)


def _sampled(picture: Array, at: Array) -> Array:
    """Colours (H, W, 3) of a picture (h, w, 3) at points [px], (H, W, 2), averaged over the distance of the points."""
    step = max(float(np.median(np.abs(np.diff(at[..., 0], axis=1)))), 1e-9)
    if step > 1:  # several of its pixels in one
        height, width = (max(1, round(n / step)) for n in picture.shape[:2])
        at = at * (width / picture.shape[1], height / picture.shape[0])
        small = Image.fromarray(np.rint(picture * 255).astype(np.uint8)).resize((width, height), Image.Resampling.BOX)
        picture = np.asarray(small) / np.float32(255)
    where = np.moveaxis(at[..., ::-1] - 0.5, -1, 0)
    return np.stack(
        [scipy.ndimage.map_coordinates(picture[..., c], where, order=1, mode="nearest") for c in range(3)], axis=-1
    )


def _hole(mask: Array) -> Array:
    """The object and its rim, (H, W) bool."""
    reach = max(1, round(RIM * max(mask.shape)))
    out: Array = scipy.ndimage.binary_dilation(mask, iterations=reach)
    return out


def filled(picture: Array, hole: Array) -> Array:
    """A picture (H, W, 3) whose hole, (H, W) bool, is filled by the membrane through its rim, with the ground's grain.

    The membrane solves Laplace's equation on a coarse grid: it is smooth, and has no value beyond those of the rim.
    """
    if not hole.any() or hole.all():
        return picture
    height, width = hole.shape
    factor = min(1.0, COARSE / max(height, width))
    small = max(3, round(width * factor)), max(3, round(height * factor))
    weight = _shrunk((~hole).astype(np.float32), small)
    known = weight > 0.5
    colours = np.stack([_shrunk(picture[..., c] * ~hole, small) / np.maximum(weight, 1e-6) for c in range(3)], axis=-1)
    membrane = _membrane(colours, known)
    smooth = np.stack([_enlarged(membrane[..., c], (width, height)) for c in range(3)], axis=-1)
    out: Array = np.where(hole[..., None], np.clip(smooth + _grain(picture, hole), 0, 1), picture).astype(np.float32)
    return out


def _shrunk(channel: Array, size: tuple[int, int]) -> Array:
    """A channel as the means over the pixels of a smaller size (width, height)."""
    return np.asarray(Image.fromarray(channel.astype(np.float32)).resize(size, Image.Resampling.BOX))


def _enlarged(channel: Array, size: tuple[int, int]) -> Array:
    """A channel in a larger size (width, height)."""
    return np.asarray(Image.fromarray(channel.astype(np.float32)).resize(size, Image.Resampling.BICUBIC))


def _membrane(colours: Array, known: Array) -> Array:
    """Colours (h, w, 3) where each unknown pixel is the mean of its neighbours; `known` is (h, w) bool."""
    height, width = known.shape
    number = np.full(known.shape, -1)
    number[~known] = np.arange(int((~known).sum()))
    out = colours.astype(np.float64)
    if known.all() or not known.any():
        return out
    r, c = np.nonzero(~known)
    here, count = number[r, c], np.zeros(len(r))
    rows, columns, right = [], [], np.zeros((len(r), 3))
    for dr, dc in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        y, x = r + dr, c + dc
        inside = (0 <= y) & (y < height) & (0 <= x) & (x < width)
        count += inside
        y, x, i = y[inside], x[inside], here[inside]
        fixed = known[y, x]
        np.add.at(right, i[fixed], out[y[fixed], x[fixed]])
        rows.append(i[~fixed])
        columns.append(number[y[~fixed], x[~fixed]])
    i, j = np.concatenate([here, *rows]), np.concatenate([here, *columns])
    values = np.concatenate([count, *(np.full(len(k), -1.0) for k in rows)])
    matrix = scipy.sparse.csr_matrix(scipy.sparse.coo_matrix((values, (i, j)), shape=(len(r), len(r))))
    out[~known] = scipy.sparse.linalg.spsolve(matrix, right).reshape(-1, 3)
    return out


def _grain(picture: Array, hole: Array) -> Array:
    """Noise (H, W, 1) as strong as the finest structure of the ground, so that the fill is no smooth patch."""
    grey = picture.mean(axis=2)
    fine = (grey - scipy.ndimage.gaussian_filter(grey, GRAIN))[~hole]
    spread = 1.48 * float(np.median(np.abs(fine))) if fine.size else 0.0
    noise: Array = np.random.default_rng(0).normal(0, spread, hole.shape)[..., None]
    return noise
