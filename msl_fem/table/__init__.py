"""The magnetic table: force and flux linkage over gap and current from one coenergy."""

from msl_fem.table.magnetic_table import MagneticTable, read_table, write_table

__all__ = ["MagneticTable", "read_table", "write_table"]
