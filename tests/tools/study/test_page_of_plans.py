"""The page of plans states what the first seeds of its study give."""

import math
import re
from pathlib import Path

from steer_by_wire.closed_loop.studies.result_reader import read_results
from tests.support.runs.small_study import complete
from tests.support.suite.combinations import sampled

PAGE = Path(__file__).parents[3] / "docs" / "packet.md"
SEEDS = 10
ON_PAGE_S = ("0.2", "0.4")
MEANS_S = sampled(ON_PAGE_S[1:], ON_PAGE_S)


def test_the_page_of_plans_says_what_the_same_seeds_give(tmp_path: Path) -> None:
    """The first of the seeds, computed again."""
    shipped = Path(__file__).parents[3] / "closed_loop" / "studies" / "compare_at_speed.toml"
    text = shipped.read_text(encoding="utf-8")
    few = text.replace("[0.0, 0.1, 0.2, 0.3, 0.4]", f"[{', '.join(MEANS_S)}]")
    few = re.sub(r"(?m)^replicates = \d+$", f"replicates = {SEEDS}", few)
    few = re.sub(r"\[[^]]*5000 kg\"\]\n(.*= .*\n)+", "", few)  # not on the page
    _, rows = read_results(complete(tmp_path, text=few).folder)
    lines, network = [], ""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if re.fullmatch(r"\*\*.*\*\*", line):
            network = line.strip("*")
        if line.count("|") == 4 and ".0" in line:
            law, *cells = (cell.strip() for cell in line.strip("|").split("|"))
            for mean_s, peaks_m in zip(ON_PAGE_S, cells, strict=True):
                if mean_s in MEANS_S:
                    lines.append([network, mean_s, law, *peaks_m.split(", ")])
    assert len(lines) == len(MEANS_S) * 4
    for network, mean_s, law, *figures in lines:
        at = (
            (rows["network"] == network)
            & (rows["mean_s"] == float(mean_s))
            & (rows["controller"] == law)
        )
        peak_m = rows["peak_m"][at]
        assert len(peak_m) == SEEDS
        median_m, _, worst_m = (
            math.inf if figure == "lost" else float(figure) for figure in figures
        )
        half_digit = 0.00501
        assert peak_m.max() <= worst_m + half_digit, (network, mean_s, law)
        if median_m < math.inf:  # all on one side with a probability of 1e-3
            assert peak_m.min() <= median_m + half_digit
            assert peak_m.max() >= median_m - half_digit
