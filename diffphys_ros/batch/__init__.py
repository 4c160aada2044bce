"""Many clips, one command: one task per recording, each in processes of its own, here or on a Ray cluster (docs/batch.md)."""

from .run import Request, parse_shard, positive, run_batch
from .status import Status, read_status

__all__ = ["Request", "Status", "parse_shard", "positive", "read_status", "run_batch"]
