"""What each step takes: seconds of one core of a busy machine, so that an idle one is faster; docs/laptop.md says how
they were measured."""

from fracgen.laptop.study import SIMULATORS, Study

CORES = 2
"""Commands that run at the same time, or processes of one command."""
START = 15.0
"""A program: its imports, and what it reads before it begins."""
COMPILED = 25.0
"""Kernels of a sweep over one object."""
CLIP = {"laptop": 5.0, "preview": 20.0, "default": 90.0, "reference": 360.0}
"""A simulated clip by solver, an entry of SIMULATORS."""
VAE_STEP, ENCODED, READ = 0.25, 0.5, 0.5
"""A step of the VAE; a clip that is encoded; a clip that is read."""
BATCH = 4
"""Clips of an optimiser step."""
TRAINED = {1: 0.12, 2: 0.7, 3: 0.7}
"""A clip in an optimiser step, by stage: one stream or five."""
SAMPLED = {1: 1.2, 2: 6.0, 3: 6.0}
"""A clip that is sampled in 20 steps and decoded."""
SCORED = 10.0
"""A clip with all metrics; most of it is the network of FVD, the tracker and ST-LPIPS."""


def minutes(seconds: float) -> float:
    """Time of work on all cores [min], from seconds of one."""
    return round(seconds / CORES / 60, 1)


def simulated(study: Study, objects: int, draws: int, solver: str = "laptop") -> float:
    """Core seconds of a sweep."""
    assert solver in SIMULATORS
    return START + objects * COMPILED + objects * draws * CLIP[solver]


def held_out(study: Study) -> int:
    """Held-out clips."""
    return len(study.test_objects) * study.test_draws


def pulls(study: Study) -> int:
    """Controlled pulls."""
    from fracgen.laptop.study import SHOWN_OBJECTS, THRESHOLDS

    return len(SHOWN_OBJECTS) * len(THRESHOLDS) * len(study.angles)


def trained(study: Study, stage: int) -> float:
    """Core seconds of one training."""
    return START + BATCH * study.steps * TRAINED[stage]


def sampled(clips: int, stage: int) -> float:
    """Core seconds of a sampling command."""
    return START + clips * SAMPLED[stage]


def scored(clips: int) -> float:
    """Core seconds of an evaluation."""
    return START + clips * SCORED


def vae(study: Study) -> float:
    """Seconds of the training of the VAE, which uses one core at a time."""
    return START + study.vae_clips * READ + study.vae_steps * VAE_STEP
