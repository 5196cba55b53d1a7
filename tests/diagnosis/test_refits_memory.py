"""What candidates keep in the memory while they are screened."""

from types import SimpleNamespace

import pytest

from msl_fem.diagnosis.screening import WITH_COLUMNS, Screening


class Candidate(SimpleNamespace):
    """One with a gain, that lets its Jacobian go."""

    def __init__(self, gain: float, *, is_cut: bool) -> None:
        super().__init__(gain=gain, variant=SimpleNamespace(effect="any", name="any"), kept=True)
        self.fit = SimpleNamespace(likelihood=SimpleNamespace(is_cut=is_cut), lets_go=self._lets_go)

    def _lets_go(self) -> None:
        self.kept = False


@pytest.mark.parametrize("is_cut", [True, False])
def test_only_the_best_candidates_over_stretches_keep_their_jacobians(*, is_cut: bool) -> None:
    """In whatever order they end; those of runs that are followed as a whole are small."""
    gains = [30.0, 90.0, 10.0, 70.0, 50.0, 20.0, 80.0, 40.0, 60.0]
    screening = Screening(lambda text: None, len(gains), "a first look", lambda refit, best: False)
    every = [Candidate(gain, is_cut=is_cut) for gain in gains]
    for one in every:
        screening.ends(one.variant, one)  # type: ignore[arg-type, type-var]
    kept = sorted((one.gain for one in every if one.kept), reverse=True)
    assert kept == sorted(gains, reverse=True)[: WITH_COLUMNS if is_cut else None]
