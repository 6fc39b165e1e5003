"""A scene in Python: frames one by one, and pictures of any quantity."""

from collections.abc import Iterator

import numpy as np

from fracsim import backend
from fracsim.asset.build import build_of
from fracsim.photo.stage import staged
from fracsim.records import Array, Frame, Particles
from fracsim.render.film import Film
from fracsim.scene.knob import check_names
from fracsim.scene.vocab import Scene
from fracsim.solve.report import Report
from fracsim.solve.setup import ready
from fracsim.solve.simulator import Simulator


class Run:
    """Prepares the object and the solver of a scene; nothing is written to disk.

    Raises ValueError or RuntimeError for a scene that cannot run. Worker processes must be spawned, not forked.
    """

    def __init__(self, scene: Scene) -> None:
        backend.start(scene.backend)
        check_names(scene)
        self.scene = scene = staged(scene)
        self._prepared = ready(scene)
        self._object = build_of(scene)
        self._simulator = self._at_rest()
        self._started = False
        self._film = Film(scene)

    def _at_rest(self) -> Simulator:
        """A simulator that has not begun."""
        return Simulator(self.scene, self._object, prepared=self._prepared)

    @property
    def particles(self) -> Particles:
        """The object at rest, in the order of the arrays of each frame."""
        return self._simulator.particles

    @property
    def report(self) -> Report:
        """What has been counted so far: `report.history`, `report.summary()`."""
        return self._simulator.report

    def frames(self) -> Iterator[Frame]:
        """Yield frame 0 (the rest state), 1, 2, ...; raises SimulationError where the simulation fails.

        Each call begins at rest; an iterator of an earlier call must not be used any more.
        """
        backend.check_process()
        if self._started:
            self._simulator = self._at_rest()
        self._started = True
        for frame in self._simulator.frames():
            yield frame
            backend.check_process()

    def render(self, frame: Frame, quantity: Array | None = None) -> tuple[Array, Array]:
        """A picture (H, W, C) float32 of a quantity a particle, (N,) or (N, C), on zero; and its alpha (H, W).

        Without a quantity, the colour of the object, premultiplied by alpha. Raises ValueError for another shape.
        """
        backend.check_process()
        if quantity is not None and (np.ndim(quantity) not in (1, 2) or len(quantity) != len(frame.x)):
            raise ValueError(f"render: quantity has shape {np.shape(quantity)}, but a value a particle is wanted: "
                             f"({len(frame.x)},) or ({len(frame.x)}, C).")  # fmt: skip
        values = self._film.colours(frame, self.particles) if quantity is None else np.asarray(quantity, np.float32)
        features = values[:, None] if values.ndim == 1 else values
        image, alpha, _ = self._film.splat(frame, self.particles, features)
        return image, alpha
