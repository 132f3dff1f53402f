"""A study as text, and its runs in another process.

Every process makes the study from its settings by itself and keeps what runs share, as a thread
does.
"""

import json
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from ...studies.compute import Computed, Computer
from ...studies.sampling import make_design
from ...studies.scenario import Scenarios
from ...studies.study import Study, study_factors
from ...studies.study_file import StudySettings


def compute_block(payload: str, ids: Sequence[int]) -> Computed:
    """Compute runs of the study that ``payload_of`` has described."""
    return _computer(payload).compute(ids, lambda: False)


@lru_cache(maxsize=2)
def _computer(payload: str) -> Computer:
    study = json.loads(payload)
    settings = StudySettings.model_validate_json(json.dumps(study["settings"]))
    design = make_design(study_factors(settings, study["file"]), settings.sampling)
    tables = study["plant"], study["controllers"]
    made = Study(study["file"], settings, *tables, design, study["fastmath"], study["bus"])
    return Computer(Scenarios(made))


def payload_of(study: Study) -> str:
    """Return a study as text, from which another process makes it again."""
    return json.dumps(
        {
            "file": str(Path(study.file).name),
            "settings": study.settings.model_dump(mode="json", exclude_none=True),
            "plant": study.plant,
            "controllers": study.controllers,
            "fastmath": study.fastmath,
            "bus": study.bus,
        }
    )
