"""Both algorithms of Maas and Vosselman on the primitives of a ground plan, and their steps."""

from eaves.reconstruct.maas_vosselman.method import MaasVosselman

__all__ = ["MaasVosselman"]
