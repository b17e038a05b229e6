"""Changes of a job's frames that are too many for a single transaction."""

from __future__ import annotations

import logging

from service.errors import FarmError
from service.events import RowWritten
from service.farm import Farm
from service.jobs.describe import describe
from service.maintenance.reuse import InitialValues
from service.models.jobs import JobOut

__all__ = ["carry_out_and_describe"]

log = logging.getLogger(__name__)


def carry_out_and_describe(id: str, farm: Farm, begun: InitialValues | None = None) -> JobOut:
    """Applies the pending changes of a job's frames and returns the API's model of the job.

    If that fails, the changes are retried in the background. begun: initial column values of frames with reused samples.
    """
    try:
        farm.frame_changes.carry_out(id, begun)
    except FarmError as error:
        log.warning("job %s: changes of its frames are postponed: %s", id, error)
    farm.events.publish(RowWritten("job", id))
    return describe(id, farm)
