"""The section of RESULTS.md on surfaces."""

from model.evaluation.surfaces import SERVED
from model.report.surfaces import section
from tests.support.small.trials import trials


def test_section_surfaces_above_and_below_the_bars_says_which_are_met() -> None:
    page = section(trials(0.39, 50))
    assert f"| {SERVED} | 0.195 | 0.390 | 0.975 | 50% | 15 | 50 | 50 |" in page
    assert (page.count(", met."), page.count("not met")) == (2, 0)
    assert section(trials(0.37, 501)).count("**not met**") == 2
