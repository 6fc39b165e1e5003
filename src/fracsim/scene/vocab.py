"""The vocabulary of a scene: object, material, fracture, loading, solver, camera, capture, backend, output.

Plain dataclasses in SI units (angles in degrees, counter-clockwise from image right). They are the schema of the
YAML files in `conf/`: a key that is not here, or a value outside its range, is one clear error (ValueError).
"""

import math
import os
from dataclasses import dataclass, field

from fracsim.scene.knob import check, knob

DOMAIN = 2.0
"""Edge of the paper's cubic domain [m]; a cell has the size DOMAIN / solver.cells."""
CENTRE = (1.0, 1.0, 1.0)
"""Centre of the placed object [m]."""
DT0, H0 = 1e-4, DOMAIN / 150
"""Substep [s] and cell size [m] at which the paper quotes its damping."""
LABELS = ("quality",)
"""Fields that say where values came from; scenes that differ in nothing else are the same scene."""


@dataclass(kw_only=True)
class Asset:
    """The object under load."""

    kind: str = knob("builtin", "where the object comes from", choices=("builtin", "mesh", "ply", "image"))
    name: str = knob("bread", "built-in object (kind=builtin)", package="fracsim.asset.objects")
    path: str = knob("", "mesh (OBJ, GLB, glTF, PLY, STL), trained 3DGS point_cloud.ply, or photo (PNG, JPEG, WebP)")
    size: float = knob(0.6, "largest extent after scaling", "m", least=0.01, most=1.6)
    rotate_deg: list[float] = knob([0.0, 0.0, 0.0], "rotation about x, then y, then z, before placing", "deg",
                                   least=-360, most=360)  # fmt: skip
    interior: str = knob("", "colour inside an object from a file, as #rrggbb; empty = that of its surface")
    mask: str = knob("", "picture that is white, or opaque, on the object in the photo; empty = the object is found")
    cutout: str = knob("auto", "how the object is found in the photo, a module of fracsim.photo.cutouts or a file "
                       "./CUTOUT.py", package="fracsim.photo.cutouts")  # fmt: skip
    depth: float = knob(0.7, "thickness of the body inflated from the photo, in the smaller side of the outline's box",
                        least=0.05, most=2.0)  # fmt: skip
    back: str = knob("round", "back of that body: round: as its front; flat: in the plane of the outline",
                     choices=("round", "flat"))  # fmt: skip
    base: str = knob("round", "foot of that body: round: as its other sides; flat: as of what stands on a table",
                     choices=("round", "flat"))  # fmt: skip
    opacity_threshold: float = knob(0.02, "drop splats of lower opacity (kind=ply)", least=0, most=1)
    max_particles: int = knob(3_000_000, "refuse objects that need more particles", least=1)

    def __post_init__(self) -> None:
        check(self, "asset")
        self.path, self.mask = os.path.expanduser(self.path), os.path.expanduser(self.mask)
        if self.kind != "builtin" and not self.path:
            raise ValueError(f"asset.path is empty but asset.kind={self.kind} needs a file: set asset.path=FILE.")
        if self.kind == "builtin" and self.path:
            raise ValueError(f"asset.path={self.path} has no effect with the built-in {self.name}: set asset=mesh for "
                             "a mesh, asset=ply for trained splats, asset=image for a photo, or leave it "
                             "out.")  # fmt: skip


@dataclass(kw_only=True)
class Material:
    """The undamaged solid."""

    law: str = knob("fixed_corotated", "constitutive law, a module of fracsim.constitutive or a file ./LAW.py",
                    package="fracsim.constitutive")  # fmt: skip
    E: float = knob(6e3, "Young's modulus", "Pa", least=1e2, most=1e9)
    nu: float = knob(0.25, "Poisson's ratio", least=0.0, most=0.499)
    density: float = knob(200.0, "mass density at rest", "kg/m^3", least=1.0, most=2e4)
    viscosity: float = knob(0.0, "RPIC damping as a viscosity 2 eta = r rho h0^2 / (4 dt0)", "Pa s",
                            least=0.0, most=1e5)  # fmt: skip
    decay: float = knob(0.0, "grid velocity decay rate -ln(g) / dt0", "1/s", least=0.0, most=1e4)

    def __post_init__(self) -> None:
        check(self, "material")

    @property
    def mu(self) -> float:
        """Shear modulus [Pa]."""
        return self.E / (2 * (1 + self.nu))

    @property
    def lam(self) -> float:
        """First Lame parameter [Pa]."""
        return self.E * self.nu / ((1 + self.nu) * (1 - 2 * self.nu))


@dataclass(kw_only=True)
class Fracture:
    """When the material loses its strength (Eq. 4 of the paper)."""

    law: str = knob("stretch", "damage law, a module of fracsim.damage or a file ./LAW.py", package="fracsim.damage")
    onset: float = knob(1.5, "largest principal stretch at which damage begins", least=1.0, most=10.0)
    crit: float = knob(2.3, "stretch at which the material has failed", least=1.0, most=10.0, open="least")
    length: float = knob(0.0, "cell size for which onset and crit are meant; on other cells lambda_crit is rescaled "
                         "so that the fracture energy per area stays the same; 0 = no rescaling", "m",
                         least=0.0, most=1.0)  # fmt: skip
    at_grips: bool = knob(False, "accumulate damage also in grip particles, and beside them at unchanged thresholds")

    def __post_init__(self) -> None:
        check(self, "fracture")
        if self.crit <= self.onset:
            raise ValueError(
                f"fracture.crit={self.crit} must be greater than fracture.onset={self.onset}: "
                "damage grows from onset to crit. Raise fracture.crit or lower fracture.onset."
            )


@dataclass(kw_only=True)
class Loading:
    """Two grips that move apart along an axis in the image plane."""

    axis_deg: float = knob(0.0, "tearing axis, counter-clockwise from image right", "deg", least=-360, most=360)
    offset: float = knob(0.15, "distance of each grip's centre from the object's centre", "m", least=0.0, most=1.0)
    speed: float = knob(0.6, "speed of each grip", "m/s", least=0.0, most=20.0, open="least")
    thickness: float = knob(0.05, "full thickness of a grip along the axis", "m", least=0.0, most=1.0, open="least")
    grips: str = knob("rigid", "rigid: particles and nodes move by v t; sliding: the same, free to contract across "
                      "the axis; soft: particles only, before P2G", choices=("rigid", "sliding", "soft"))  # fmt: skip
    gravity: list[float] = knob([0.0, 0.0, 0.0], "acceleration", "m/s^2", least=-1e3, most=1e3)

    def __post_init__(self) -> None:
        check(self, "loading")
        if len(self.gravity) != 3:
            raise ValueError(f"loading.gravity={self.gravity} must have three components, as [0,-9.81,0].")
        if 2 * self.offset <= self.thickness:
            raise ValueError(
                f"loading.offset={self.offset} leaves no material between grips of thickness {self.thickness}: "
                f"set loading.offset above {self.thickness / 2:g}."
            )

    @property
    def axis(self) -> tuple[float, float, float]:
        """Unit vector of the tearing axis."""
        a = math.radians(self.axis_deg)
        return (math.cos(a), math.sin(a), 0.0)

    @property
    def gauge(self) -> float:
        """Length of material between the faces of the grips [m]."""
        return 2 * self.offset - self.thickness


@dataclass(kw_only=True)
class Solver:
    """How the motion is computed."""

    formulation: str = knob("total", "total: weights from the rest configuration; updated: from the present one",
                            choices=("total", "updated"))  # fmt: skip
    cells: int = knob(150, "grid cells along the paper's 2 m domain; h = 2 / cells", least=8, most=2000)
    particles_per_axis: float = knob(2.0, "particles per cell and axis at rest", least=1.0, most=8.0)
    lattice: str = knob("axis", "directions of the lattices of nodes and particles at rest: axis: along and across the "
                        "tearing axis; world: x, y and z, as in the paper", choices=("axis", "world"),
                        pinned="world")  # fmt: skip
    dt: float | int | str = knob("auto", "substep: auto (stability bound), or a fixed value in s", least=0, most=1.0,
                           open="least", choices=("auto",))  # fmt: skip
    dt_override: bool = knob(False, "allow a fixed dt beyond the stability bound at rest")
    safety: float = knob(0.8, "fraction of the stability bound that dt: auto takes", least=0.01, most=1.0)
    projection: float | int | str = knob(
        0.5, "projections of the velocities on the particles while a wave crosses a cell (total); every: one in each "
        "substep, as in APIC", least=0, most=1e3, choices=("every",))  # fmt: skip
    pressure: str = knob("auto", "cell: from the mean J of the particles that share a cell at rest, free of locking "
                         "near nu = 0.5; particle: from its own J; auto: cell in total, particle in updated",
                         choices=("auto", "cell", "particle"))  # fmt: skip
    damping: str = knob("physical", "physical: viscosity and decay rate; per_substep: the paper's factors in each "
                        "substep, independent of dt; none", choices=("physical", "per_substep", "none"))  # fmt: skip
    precision: str = knob("float32", "floating-point type of the simulation", choices=("float32", "float64"))
    walls: bool = knob(False, "sticky walls three cells inside the [0, 2]^3 domain (updated)")
    until: str = knob("end", "end: simulate all frames; settled (total): once the pieces only follow their grips, move "
                      "them rigidly instead of simulating them", choices=("end", "settled"))  # fmt: skip
    max_speed: float = knob(500.0, "stop the run when a particle is faster", "m/s", least=1.0, most=1e5)

    def __post_init__(self) -> None:
        check(self, "solver")
        self.dt, self.projection = (v if isinstance(v, str) else float(v) for v in (self.dt, self.projection))
        if self.walls and self.formulation == "total":
            raise ValueError("solver.walls=true needs present positions: set solver.formulation=updated.")
        if self.walls and self.lattice == "axis":
            raise ValueError("solver.walls=true are walls across x, y and z: set solver.lattice=world.")
        if self.pressure == "cell" and self.formulation == "updated":
            raise ValueError(
                "solver.pressure=cell needs cells that keep their particles: set solver.formulation=total, or "
                "solver.pressure=auto."
            )
        if self.until == "settled" and self.formulation == "updated":
            raise ValueError("solver.until=settled needs fragments, unknown in updated: set solver.formulation=total.")

    @property
    def h(self) -> float:
        """Cell size [m]."""
        return DOMAIN / self.cells

    @property
    def cellwise(self) -> bool:
        """Whether the particles of a cell share one pressure: solver.pressure, with auto resolved."""
        return self.formulation == "total" and self.pressure != "particle"

    @property
    def spacing(self) -> float:
        """Particle spacing at rest [m]."""
        return self.h / self.particles_per_axis


@dataclass(kw_only=True)
class Camera:
    """Default: front view that frames the full travel of both grips."""

    width: int = knob(512, "picture width, a multiple of 16", "px", least=16, most=4096)
    height: int = knob(512, "picture height, a multiple of 16", "px", least=16, most=4096)
    fov_deg: float = knob(40.0, "vertical field of view", "deg", least=1.0, most=120.0)
    azimuth_deg: float = knob(0.0, "orbit about the vertical; 0 looks along -z", "deg", least=-360, most=360)
    elevation_deg: float = knob(0.0, "orbit upwards", "deg", least=-89, most=89)
    half_width: float = knob(0.0, "half width of the view at the object's centre; 0 = frames the full travel of both "
                             "grips", "m", least=0.0, most=100.0)  # fmt: skip
    background: str = knob("white", "what is behind the object: white; photo: that of asset=image without its object, "
                           "seen from where the photo was taken", choices=("white", "photo"))  # fmt: skip
    matrix: list[float] = knob([], "explicit world-to-camera matrix, 16 numbers by rows (x right, y down, z ahead)",
                               least=-1e6, most=1e6)  # fmt: skip
    intrinsics: list[float] = knob([], "explicit fx, fy, cx, cy, together with matrix", "px", least=-1e6, most=1e6)

    def __post_init__(self) -> None:
        check(self, "camera")
        for name in ("width", "height"):
            if getattr(self, name) % 16:
                raise ValueError(f"camera.{name}={getattr(self, name)} must be a multiple of 16, as 512.")
        if (len(self.matrix), len(self.intrinsics)) not in ((0, 0), (16, 4)):
            raise ValueError(
                f"camera.matrix has {len(self.matrix)} and camera.intrinsics {len(self.intrinsics)} numbers: "
                "give 16 and 4, or leave both empty."
            )


@dataclass(kw_only=True)
class Capture:
    """What is recorded."""

    frames: int = knob(100, "number of frames; frame k shows t = k / fps, frame 0 the rest state", least=1, most=10_000)
    fps: float = knob(100.0, "frames per second of simulated time", "1/s", least=1.0, most=1e5)
    rgb: bool = knob(True, "render colour")
    maps: list[str] = knob(["flow", "strain", "stress", "damage"],
                           "physics maps, modules of fracsim.maps or files ./MAP.py",
                           package="fracsim.maps")  # fmt: skip
    tracks: int = knob(2048, "surface particles with stored image paths; 0 = none", least=0, most=1_000_000)
    strip: bool = knob(True, "write strip.mp4, all pictures side by side")
    report: bool = knob(True, "write report.png, curves of load, stretch, damage and substep")
    gaussians: bool = knob(False, "write a 3DGS .ply per frame")
    particles: bool = knob(False, "write the particle state as .npz per frame")

    def __post_init__(self) -> None:
        check(self, "capture")
        if len(set(self.maps)) < len(self.maps):
            raise ValueError(f"capture.maps={self.maps} names a map twice: name each once.")

    @property
    def duration(self) -> float:
        """Simulated time up to the last frame [s]."""
        return (self.frames - 1) / self.fps

    @property
    def renders(self) -> bool:
        """Whether any picture is rendered."""
        return bool(self.rgb or self.maps)


@dataclass(kw_only=True)
class Backend:
    """Where the simulation runs; never part of a sample's identity."""

    arch: str = knob("cpu", "Taichi backend", choices=("cpu", "cuda", "vulkan", "metal"))
    threads: int = knob(0, "CPU threads; 0 = all cores", least=0, most=1024)

    def __post_init__(self) -> None:
        check(self, "backend")


@dataclass(kw_only=True)
class Output:
    """Where samples are written; never part of a sample's identity."""

    folder: str = knob("outputs", "parent of the folders of samples")
    overwrite: bool = knob(False, "repeat a finished sample")


@dataclass(kw_only=True)
class Scene:
    """All inputs of one simulation."""

    quality: str = knob("default", "preset of this scene (a label)")
    seed: int = knob(0, "seed of every random choice", least=0, most=2**31 - 1)
    condition: str = knob("", "JSON file of a pull on the photo of asset=image, as the annotation page writes it: it "
                          "sets material.E and nu, fracture.onset and crit, loading.axis_deg, offset and speed, and "
                          "capture.fps")  # fmt: skip
    asset: Asset = field(default_factory=Asset)
    material: Material = field(default_factory=Material)
    fracture: Fracture = field(default_factory=Fracture)
    loading: Loading = field(default_factory=Loading)
    solver: Solver = field(default_factory=Solver)
    camera: Camera = field(default_factory=Camera)
    capture: Capture = field(default_factory=Capture)
    backend: Backend = field(default_factory=Backend)
    output: Output = field(default_factory=Output)

    def __post_init__(self) -> None:
        check(self, "")
        self.condition = os.path.expanduser(self.condition)
        of_photo = {"condition": self.condition, "camera.background": self.camera.background}
        for name, value in of_photo.items():
            if value not in ("", "white") and self.asset.kind != "image":
                raise ValueError(f"{name}={value} needs a photo, but asset.kind={self.asset.kind}: set asset=image and "
                                 f"asset.path=PHOTO, or leave {name} out.")  # fmt: skip
        if self.solver.max_speed <= self.loading.speed:
            raise ValueError(
                f"solver.max_speed={self.solver.max_speed:g} is not above loading.speed={self.loading.speed:g} m/s, "
                "so the grips alone would stop the run. Raise solver.max_speed."
            )

    @property
    def lattice_deg(self) -> float:
        """Angle of the lattices from the world's axes, counter-clockwise [deg], 0 to 90."""
        return self.loading.axis_deg % 90 if self.solver.lattice == "axis" else 0.0
