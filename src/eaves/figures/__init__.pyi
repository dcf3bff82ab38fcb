from .party_walls import PARTY_GAP as PARTY_GAP
