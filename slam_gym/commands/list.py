"""`slam-gym list`: what there is, one line each, or the page of one."""

import inspect
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import tyro

SECTIONS = ("scenarios", "estimators", "policies", "environments")
ENVIRONMENT = "SlamTarget-v0"
VECTOR = "SlamTargetVectorEnv"


@dataclass(frozen=True)
class List:
    """List scenarios, estimators, policies and environments, or print the page of one of them.

    Installed packages add estimators and policies; they appear here by themselves.

    Examples:
      slam-gym list
      slam-gym list estimators
      slam-gym list my.toml        a scenario file's numbers, with those that it leaves out
      slam-gym list slamto         the scenario's numbers, and the estimator of the same name with its options
    """

    name: Annotated[str, tyro.conf.Positional] = ""
    """A kind (scenarios, estimators, policies, environments) or a name; none: everything."""

    def run(self) -> int:
        """Print."""
        from rich.console import Console

        console = Console(highlight=False, markup=False)
        if self.name in ("", *SECTIONS):
            for section in SECTIONS if not self.name else (self.name,):
                _print_section(console, section)
            return 0
        for page in pages(self.name):
            console.print(page, soft_wrap=True)
        return 0


def entries(section: str) -> Iterator[tuple[str, str]]:
    """(name, one line) of everything of a kind; what cannot be loaded says why."""
    from estimators import registry
    from slam_gym import policies
    from slam_gym.scenario import Scenario, scenario_names

    if section == "scenarios":
        for name in scenario_names():
            yield name, Scenario.load(name).summary
    elif section == "estimators":
        yield from ((name, _line(registry.get, name)) for name in registry.names())
    elif section == "policies":
        yield from ((name, _line(policies.get, name)) for name in policies.names())
    else:
        yield ENVIRONMENT, 'gym.make("slam_gym:SlamTarget-v0", scenario=..., estimator=...)'
        yield VECTOR, 'gym.make_vec("slam_gym:SlamTarget-v0", num_envs=..., scenario=..., estimator=...)'


def _line(get: Callable[[str], Any], name: str) -> str:
    try:
        found = get(name)
    except (ImportError, AttributeError) as error:
        return f"({error})"
    return found.summary or (inspect.getdoc(found) or "").partition("\n")[0]


def _print_section(console: Any, section: str) -> None:
    from rich.table import Table

    table = Table(title=section.capitalize(), title_justify="left", title_style="bold", box=None, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column()
    for name, line in entries(section):
        table.add_row(f"  {name}", line)
    console.print(table)
    console.print()


def pages(name: str) -> list[str]:
    """The page of everything with that name.

    Raises:
        ValueError: nothing has it.
    """
    from estimators import registry
    from slam_gym import policies
    from slam_gym.scenario import Scenario, scenario_names

    found = []
    if name in scenario_names() or name.endswith(".toml"):
        found.append(_scenario_page(name, Scenario.load(name)))
    if name in registry.names():
        found.append(_class_page("estimator", name, registry.get(name)))
    if name in policies.names():
        found.append(_class_page("policy", name, policies.get(name)))
    if name.lower() == ENVIRONMENT.lower():
        from slam_gym.envs.slam_target import SlamTargetEnv

        found.append(_class_page("environment", ENVIRONMENT, SlamTargetEnv))
    if name.lower() == VECTOR.lower():
        from slam_gym.envs.slam_target_vector import SlamTargetVectorEnv

        found.append(_class_page("environment", VECTOR, SlamTargetVectorEnv))
    if not found:
        names = [*scenario_names(), *registry.names(), *policies.names(), ENVIRONMENT, VECTOR, *SECTIONS]
        raise ValueError(registry.unknown_name("name", name, list(dict.fromkeys(names))))
    return found


def _scenario_page(name: str, scenario: Any) -> str:
    lines = [f"Scenario {name}", "", scenario.summary, "", "Every number, as --set takes it:", ""]
    lines += [f"  {key} = {json.dumps(value)}" for key, value in flat(scenario.to_dict())
              if key not in ("name", "summary")]  # fmt: skip
    return "\n".join([*lines, ""])


def flat(nested: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and values of nested tables."""
    for key, value in nested.items():
        if isinstance(value, Mapping) and value:
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _class_page(kind: str, name: str, cls: type) -> str:
    page = [f"{kind.capitalize()} {name}", "", inspect.getdoc(cls) or "", ""]
    options, maker = _options(cls), "make_vec" if name == VECTOR else "make"
    if options:
        example = ",".join(f"{key}={json.dumps(value)}" for key, value in list(options.items())[:1])
        page += ["Options and defaults:", *(f"  {key} = {value!r}" for key, value in options.items())]
        page += [f"Written as {name}:{example}" if kind != "environment" else f"Arguments of gym.{maker}.", ""]
    return "\n".join(page)


_NOT_OPTIONS = ("num_lanes", "max_landmarks")


def _options(cls: type) -> dict[str, Any]:
    parameters = inspect.signature(cls).parameters.values()
    return {p.name: p.default for p in parameters if p.default is not p.empty and p.name not in _NOT_OPTIONS}
