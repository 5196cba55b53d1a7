"""Written by benchmarks/diagnosis_study_tables.py: clean records' largest gains in nats, how many were named."""

CLEAN: dict[str, tuple[list[float], int]] = {}
