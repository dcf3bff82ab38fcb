"""The default detector and its steps."""

from eaves.detect.consensus.method import Consensus

__all__ = ["Consensus"]
