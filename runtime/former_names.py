"""Commands and options of the release before, and what they are called now."""

from collections.abc import Mapping
from types import MappingProxyType

FORMER_COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "benchmark": "make benchmark (in a checkout)",
        "benchmark-batch": "python -m benchmarks batch (in a checkout)",
        "benchmark-bus": "python -m benchmarks bus (in a checkout)",
        "bits": "steer-by-wire can bits",
        "bus-study": "steer-by-wire study bus",
        "compare": "steer-by-wire study compare",
        "delay-study": "steer-by-wire study delay_estimation",
        "fuzz": "python -m tests.fuzz (in a checkout)",
        "inject": "steer-by-wire faults inject",
        "probe": "steer-by-wire doctor --measure",
        "response-times": "steer-by-wire can response-times",
        "soak": "python -m pytest tests/soak (in a checkout)",
        "stress": "steer-by-wire study",
        "stress-report": "steer-by-wire study --report",
    }
)

FORMER_OPTIONS: Mapping[str, str] = MappingProxyType(
    {
        "--controller-preset": "--preset NAME",
        "--controller-set": "--set controller.TABLE.KEY=VALUE",
        "--plant-preset": "--preset NAME",
        "--plant-set": "--set plant.TABLE.KEY=VALUE",
        "--processes": "--workers N",
        "--report": "--json FILE",
        "--seconds": "--duration SECONDS",
        "--threads": "--workers N",
    }
)
