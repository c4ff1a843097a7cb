"""Makes `peer_agreement` and `forces_by_hand` importable beside the tests."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
