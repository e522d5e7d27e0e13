"""What listed options promise to explain of what a trial leaves, each at the onset that suits it."""

from __future__ import annotations

from collections.abc import Iterable

from enginediag_cli.drivers import TIME
from enginediag_cli.mismatch.explain.currency import Offer, Prices, scales_of
from enginediag_cli.mismatch.explain.members import clashes, identity
from enginediag_cli.mismatch.fit.options import OptionScore, option_scores, with_best_onset
from enginediag_cli.mismatch.fit.trial import HypothesisFit


def promising(prices: Prices, trial: HypothesisFit, scores: Iterable[OptionScore], most: int) -> list[Offer]:
    """Of each that may join the trial its best score; the `most` of these that promise most, each with the onset that
    suits what the trial leaves, and of them what promises a gain then, best first. Onsets are scored some records
    apart: beside offsets of every flight a change that promises nothing there may explain all at its own record."""
    best: dict[tuple[str, ...], Offer] = {}
    for s in scores:
        if s.score.absorbed or not s.feasible or clashes(s.option, trial.options):
            continue
        offer, own = _offer(prices, s), identity(s.option)
        if own not in best or offer.gain > best[own].gain:
            best[own] = offer
    timed = (_at_best_onset(prices, trial, o) for o in _ordered(best.values())[:most])
    return _ordered(o for o in timed if o.gain > 0.0)


def _offer(prices: Prices, s: OptionScore) -> Offer:
    price = prices.of(s.option)
    return Offer(s.option, price, prices.promise(s, scales_of(s.option), price))


def _at_best_onset(prices: Prices, trial: HypothesisFit, offer: Offer) -> Offer:
    """A change in time as it promises most; anything else as it is."""
    if offer.option.driver != TIME:
        return offer
    option = with_best_onset(trial.found, trial.projection, offer.option)
    scores = option_scores(trial.found, trial.projection, [option])
    return next((_offer(prices, s) for s in scores if s.feasible and not s.score.absorbed), offer)


def _ordered(offers: Iterable[Offer]) -> list[Offer]:
    return sorted(offers, key=lambda o: (-o.gain, o.option.label))
