"""Jobs as tasks of Ray: `hydra/launcher=ray`. The package hydra-ray-launcher would need boto3 and an older cloudpickle.

A running cluster is joined by `+hydra.launcher.init.address=auto`; without one Ray starts on this machine.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hydra.core.config_store import ConfigStore
from hydra.core.singleton import Singleton
from hydra.core.utils import JobReturn, run_job, setup_globals
from hydra.plugins.launcher import Launcher
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, OmegaConf, open_dict


@dataclass
class RayLauncherConf:
    """`hydra.launcher`."""

    _target_: str = "hydra_plugins.hydra_fracsim.ray_launcher.RayLauncher"
    init: dict[str, Any] = field(default_factory=dict)
    """Arguments of ray.init."""
    remote: dict[str, Any] = field(default_factory=lambda: {"num_cpus": 1})
    """Arguments of ray.remote: what a job needs."""


ConfigStore.instance().store(group="hydra/launcher", name="ray", node=RayLauncherConf, provider="fracsim")


class RayLauncher(Launcher):
    """Runs each job as a task of Ray and waits for all of them."""

    def __init__(self, init: Any, remote: Any) -> None:
        self._init, self._remote = dict(init), dict(remote)

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Keep what the jobs need."""
        self._context, self._task, self._config = hydra_context, task_function, config

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        """What each job came to, in order."""
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        import ray

        setup_globals()
        if not ray.is_initialized():
            ray.init(**{"include_dashboard": False, "logging_level": "warning", **self._init})
        task: Any = ray.remote(**self._remote)(_run)
        shared = ray.put((self._context, self._task, OmegaConf.to_container(self._config), Singleton.get_state()))
        jobs = [task.remote(shared, list(o), initial_job_idx + i) for i, o in enumerate(job_overrides)]
        results: Sequence[JobReturn] = ray.get(jobs)
        return results


def _run(
    shared: tuple[HydraContext, TaskFunction, Mapping[str, Any], Any], overrides: list[str], num: int
) -> JobReturn:
    """One job, in a worker of Ray."""
    context, task_function, config, state = shared
    setup_globals()
    Singleton.set_state(state)
    composed = context.config_loader.load_sweep_config(OmegaConf.create(dict(config)), overrides)
    with open_dict(composed):
        composed.hydra.job.id, composed.hydra.job.num = str(num), num
    return run_job(hydra_context=context, task_function=task_function, config=composed,
                   job_dir_key="hydra.sweep.dir", job_subdir_key="hydra.sweep.subdir")  # fmt: skip
