"""Written by benchmarks/diagnosis_study_tables.py: clean records' largest gains in nats, how many were named."""

CLEAN: dict[str, tuple[list[float], int]] = {
    "voltage": ([2.14, 1.41, 0.66, -0.02, -0.13, -0.13, -1.08, -1.10, -1.19, -1.44, -1.50], 0),
    "current": ([4.03, 0.64, 0.01, -0.42, -0.58, -0.82, -0.86, -1.08, -1.23, -1.39, -1.44], 0),
}
