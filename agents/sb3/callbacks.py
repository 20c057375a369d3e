"""What happens between two rollouts: evaluate, keep the best policy, write the checkpoint."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stable_baselines3.common.callbacks import BaseCallback

from agents.sb3 import checkpoint, store
from agents.sb3.evaluation import evaluate
from agents.sb3.policy_file import BEST, LATEST, export_policy, read_settings
from slam_gym.results import write_atomic

if TYPE_CHECKING:
    from slam_gym.envs.slam_target_vector import SlamTargetVectorEnv

CHECKPOINT, EVALUATIONS = "checkpoint.pt", "evaluations.csv"

Row = dict[str, float]
Report = Callable[[int, Row | None], None]  # (decisions so far, evaluation if there was one)


class Milestones(BaseCallback):
    """Stops at milestones, always between two rollouts, when everything that counts is in the model.

    Args:
        out: folder of the training.
        envs: to evaluate in.
        seeds: of the worlds to evaluate in.
        every: [decisions] from one milestone to the next.
        about: what policy files say of the training, and `export_policy`'s arguments.
        report: told of progress.

    Attributes:
        rows: the evaluations so far, "steps" first.
        digest: SHA-256 of the latest weights.
    """

    def __init__(
        self,
        out: Path,
        envs: "SlamTargetVectorEnv",
        seeds: list[int],
        every: int,
        about: dict[str, Any],
        report: Report,
    ) -> None:
        super().__init__()
        self.out, self.envs, self.seeds, self.every = out, envs, seeds, every
        self.about, self.report = about, report
        self.rows: list[Row] = []
        self.digest = ""

    def resume(self, rows: list[Row]) -> None:
        """Go on after these evaluations."""
        self.rows = rows
        self.digest = read_settings(self.out / LATEST)["sha256"]

    def _on_rollout_start(self) -> None:
        if not self.rows or self.model.num_timesteps >= self.rows[-1]["steps"] + self.every:
            self._milestone()

    def _on_step(self) -> bool:
        self.report(self.model.num_timesteps, None)
        return True

    def _on_training_end(self) -> None:
        if not self.rows or self.model.num_timesteps > self.rows[-1]["steps"]:
            self._milestone()

    def _milestone(self) -> None:
        row: Row = {"steps": self.model.num_timesteps, **evaluate(self._act, self.envs, self.seeds)}
        best = all(row["return"] > other["return"] for other in self.rows)
        self.rows.append(row)
        self.digest = self._export(LATEST, row)
        if best:
            self._export(BEST, row)
        write_evaluations(self.out / EVALUATIONS, self.rows)
        for name, value in row.items():
            if name != "steps":
                self.logger.record(f"evaluation/{name}", value)
        self.logger.dump(int(row["steps"]))
        store.save(self.out / CHECKPOINT, {"rows": self.rows, "model": checkpoint.capture(self.model)})
        self.report(int(row["steps"]), row)

    def _act(self, observations: Any) -> Any:
        normalise = self.model.get_vec_normalize_env()
        shown = observations if normalise is None else normalise.normalize_obs(observations)
        return self.model.predict(shown, deterministic=True)[0]

    def _export(self, name: str, row: Row) -> str:
        arguments = {key: value for key, value in self.about.items() if key != "training"}
        training = {**self.about["training"], "evaluation": row}
        return export_policy(self.model, self.out / name, training=training, **arguments)


def write_evaluations(file: Path, rows: list[Row]) -> None:
    """The evaluations as CSV."""
    lines = [",".join(rows[0])]
    lines += [",".join(f"{value:.8g}" for value in row.values()) for row in rows]
    write_atomic(file, lambda path: path.write_text("\n".join(lines) + "\n", encoding="utf-8"))
