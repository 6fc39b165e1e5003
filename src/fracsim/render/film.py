"""Films a simulation: colour, maps, alpha and tracks of a frame, from one pass over the Gaussians."""

from dataclasses import dataclass

import numpy as np

from fracsim import maps, registry
from fracsim.asset.harmonics import turned
from fracsim.camera import depths, project, view_of
from fracsim.photo.backdrop import backdrop
from fracsim.photo.outline import outline
from fracsim.records import Array, Frame, Particles
from fracsim.render.rotations import rotations
from fracsim.render.splat import Splatter, colours, visibility
from fracsim.scene.vocab import CENTRE, Scene

SH0 = 0.28209479177387814
"""The constant spherical harmonic, 1 / (2 sqrt(pi))."""


@dataclass(frozen=True)
class Picture:
    """One filmed frame."""

    rgb: Array | None
    """Colour on white, (H, W, 3) uint8."""
    alpha: Array | None
    """Coverage, (H, W)."""
    maps: dict[str, Array]
    """Composited quantities on zero (Eq. 6), (H, W, C) each: the quantity times its coverage."""
    median: Array | None
    """Depth where half the light is lost [m], (H, W)."""


def on_ground(image: Array, alpha: Array, ground: Array | None = None) -> Array:
    """Colours over a ground, (H, W, 3) uint8, of an image (H, W, C), RGB first, with alpha (H, W).

    `ground`, (H, W, 3) in [0, 1], is white where there is none.
    """
    # Only where alpha > 0: most pixels are empty and need no arithmetic.
    seen = alpha > 0
    out = np.full((*alpha.shape, 3), 255, np.uint8) if ground is None else np.rint(ground * 255).astype(np.uint8)
    over = image[seen, :3] + (1 - alpha[seen])[:, None] * (1 if ground is None else ground[seen])
    out[seen] = np.rint(np.clip(over, 0, 1) * 255).astype(np.uint8)
    return out


class Film:
    """Renders frames of one scene; colour and maps are one feature vector, composited in one pass."""

    def __init__(self, scene: Scene) -> None:
        self.view = view_of(scene)
        self.scene = scene
        self.maps = {registry.label(name): maps.load(name) for name in scene.capture.maps}
        self.channels = 3 * scene.capture.rgb + sum(m.CHANNELS for m in self.maps.values())
        self.splatter = Splatter(self.view, self.channels) if self.channels else None
        self.ground = None
        if scene.camera.background == "photo" and scene.capture.rgb:
            self.ground = backdrop(outline(scene.asset), scene.asset.size, self.view)
        self._culled, self._when = 0, 0
        self._empty = False

    def splat(self, frame: Frame, particles: Particles, features: Array) -> tuple[Array, Array, Array]:
        """Image (H, W, C), alpha (H, W) and median depth (H, W) [m] of any features a particle, (N, C)."""
        if self.splatter is None or self.splatter.features != features.shape[1]:
            self.splatter = Splatter(self.view, features.shape[1])
        return self.splatter.render(frame.x, particles.covariance, frame.F, particles.opacity, features)

    def colours(self, frame: Frame, particles: Particles) -> Array:
        """Colour of each Gaussian as the camera sees it, (N, 3)."""
        if particles.sh.shape[1] == 1:  # the same from every direction: no rotation needed
            return np.maximum(0.5 + SH0 * particles.sh[:, 0], 0).astype(np.float32)
        return colours(self.view, frame.x, particles.sh, rotations(frame.F))

    def shoot(self, frame: Frame, particles: Particles) -> Picture:
        """Film one frame."""
        if not self.channels:
            return Picture(None, None, {}, None)
        parts = [self.colours(frame, particles)] if self.scene.capture.rgb else []
        parts += [maps.values(name, m, frame, self.view.rotation) for name, m in self.maps.items()]
        image, alpha, median = self.splat(frame, particles, np.concatenate(parts, axis=1, dtype=np.float32))
        self._watch(frame, alpha)
        rgb, pictures, at = None, {}, 0
        if self.scene.capture.rgb:
            rgb, at = on_ground(image, alpha, self.ground), 3
        for name, m in self.maps.items():
            pictures[name] = image[..., at : at + m.CHANNELS]
            at += m.CHANNELS
        return Picture(rgb, alpha, pictures, median)

    def _watch(self, frame: Frame, alpha: Array) -> None:
        """Note what the pictures of a frame with coverage `alpha`, (H, W), do not show."""
        culled = int(np.count_nonzero(depths(self.view, frame.x) <= self.view.near))
        if culled > self._culled:
            self._culled, self._when = culled, frame.index
        self._empty |= frame.index == 0 and not alpha.any()

    def warnings(self) -> list[str]:
        """What the frames that were shot do not show, or show otherwise than asked for."""
        camera, view, found = self.scene.camera, self.view, []
        if not camera.matrix and view.fov_deg < camera.fov_deg * (1 - 1e-9):
            found.append(
                f"camera.fov_deg={camera.fov_deg:g} would bring the eye into the reach of the object: it is "
                f"{np.linalg.norm(view.eye - CENTRE):.3g} m from the object's centre, with {view.fov_deg:.3g} degrees; "
                f"the half width of the view is as asked for"
            )
        if self._culled:
            found.append(
                f"{self._culled} particles of frame {self._when} are not drawn, since they are nearer than "
                f"{view.near:.3g} m to the eye, or behind it: move the camera away from the object"
            )
        if self._empty:
            found.append("the pictures of frame 0 are empty: the camera does not see the object; turn or move it")
        return found

    def choose_tracks(self, frame: Frame, particles: Particles, picture: Picture) -> Array:
        """Sorted indices (M,) of surface particles visible in `frame`, drawn at random with the scene's seed.

        M is capture.tracks, or the number of visible surface particles if there are fewer.
        """
        seen = particles.surface.copy()
        if picture.median is not None:
            seen &= visibility(self.view, picture.median, frame.x, particles.spacing)
        candidates = np.flatnonzero(seen)
        count = min(self.scene.capture.tracks, len(candidates))
        rng = np.random.default_rng(np.random.SeedSequence([self.scene.seed, 1]))
        return np.sort(rng.choice(candidates, count, replace=False))

    def tracks(self, frame: Frame, tracked: Array, picture: Picture) -> tuple[Array, Array]:
        """Image positions [px], (M, 2), of the particles `tracked`, (M,), and whether each is seen, (M,) bool."""
        x = frame.x[tracked]
        xy = project(self.view, x)[0]
        if picture.median is None:
            return xy, np.zeros(len(x), bool)
        return xy, visibility(self.view, picture.median, x, self.scene.solver.spacing)

    @staticmethod
    def gaussians(frame: Frame, particles: Particles) -> tuple[Array, Array, Array, Array]:
        """The deformed Gaussians: means (N, 3) [m], covariances F A F^T (N, 6) [m^2], opacities (N,), SH coefficients
        (N, K, 3). The coefficients have turned with the material.
        """
        xx, xy, xz, yy, yz, zz = particles.covariance.T
        A = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
        B = frame.F @ A @ frame.F.transpose(0, 2, 1)
        upper = np.triu_indices(3)
        sh = particles.sh if particles.sh.shape[1] == 1 else turned(particles.sh, rotations(frame.F))
        return frame.x, B[:, upper[0], upper[1]], particles.opacity, sh
