"""Files of the repository that the command line's tests use."""

from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
SERVO, E1 = str(ROOT / "geometries" / "fast_tool_servo.toml"), str(ROOT / "geometries" / "e1.toml")
TABLE = str(ROOT / "lookup_tables" / "fast_tool_servo.nc")
PAIR = str(ROOT / "lookup_tables" / "fast_tool_servo_pair.nc")
EMPS = str(ROOT / "measurements" / "emps")
