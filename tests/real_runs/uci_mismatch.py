"""Prints what the tool finds missing in the model of the power-plant turbine, and whether it is right.

    python tests/real_runs/uci_mismatch.py

Trained on the steady hours of 2011, judged on those of 2012. Ambient humidity is withheld; guide vanes were never
recorded. About three minutes on an idle core.
"""

from __future__ import annotations

import uci_story as uci

SCAN_THIN, FIT_THIN = 16, 8
SEPARATED = 11.0  # of χ²: the right one of two comes first 19 times out of 20
TOLD = ("humidity@ambient", "reynolds_efficiency@compressor", "computed_reading@T5", "customer_bleed@compressor")


def located() -> None:
    print(
        f"1. Where? One free amplitude per hour at each place in turn, every {SCAN_THIN}th hour of 2011, maps as "
        "they are; χ² per hour:"
    )
    for label, regime, without in (
        ("both regimes", "", ()),
        ("both regimes, without GTEP", "", ("dP_exhaust_Pa",)),
        ("base load alone", "base load", ()),
        ("base load alone, without GTEP", "base load", ("dP_exhaust_Pa",)),
    ):
        [year] = uci.load_years(
            2011, thin=SCAN_THIN // (2 if regime else 1), regime=regime, without=without, map_accuracy=0.0
        )
        found = uci.locate(year)
        best = [f"{f.name} {f.per_record:.1f}" for f in found if f.name != "nothing"][:4]
        none = next(f for f in found if f.name == "nothing")
        print(f"   {label}: nothing {none.per_record:.0f}, " + ", ".join(best))


def told(errors: uci.Errors) -> str:
    return "; ".join(
        f"{regime}: " + ", ".join(f"{s} {v:.2f} {'K' if s == 'TAT' else '%'}" for s, v in e.items())
        for regime, e in errors.items()
    )


def without_vanes() -> None:
    """The model as it is, with the maps trusted and with the tolerance that the fits with vanes have, too."""
    print("2. The model as it is, in 2012:")
    for accuracy, words in ((0.0, "maps trusted to the last digit"), (None, "maps with the engine file's tolerance")):
        train, unseen = uci.load_years(2011, 2012, thin=FIT_THIN, map_accuracy=accuracy)
        none = uci.plain(train)
        print(
            f"   {words}: {len(none.at_bound)} of {len(none.theta)} parameters end at a bound\n"
            f"   {told(uci.predicted(none, unseen, ()))}"
        )


def hidden(train: uci.Year, unseen: uci.Year) -> uci.PerRecord:
    fit = uci.vanes(train)
    print(
        f"3. Compressor flow free in every hour, 2011; in 2012 taken from CDP alone:\n"
        f"   {told(uci.predicted(fit, unseen, ('P3_Pa',)))}"
    )
    p = uci.position(train, fit)
    side = "an upper" if p.stop.upper else "a lower"
    print(
        f"4. What it looks like: {side} stop at {1 + p.stop.level:.3f} of the map's flow in "
        f"{100 * p.stop.at.mean():.0f} % of the hours, down to {1 + p.stop.beyond:.3f} away from it. By outside air:"
    )
    for low, high, count, level, scatter in p.stop.bands:
        print(f"   {low - 273.15:5.1f} to {high - 273.15:4.1f} °C: {1 + level:.3f} ± {scatter:.3f} ({count} hours)")
    for h in p.held:
        law = f": held at {h.value:.5g}" if h.held else ""
        print(
            f"   off the stop {uci.SENSORS[h.sensor]} scatters by {h.scatter:.3g}, with the flow of the stop it "
            f"would by {h.free_scatter:.3g}{law}"
        )
    print(
        "   That law alone, no coefficient fitted to it, at part load: "
        + ", ".join(f"{s} {v:.1f} %" for s, v in p.law.items())
    )
    return fit


def beside(train: uci.Year, unseen: uci.Year, fit: uci.PerRecord) -> None:
    for number, step in ((5, "second"), (6, "third")):
        second = uci.second_effect(train, fit, FIT_THIN)
        print(f"{number}. A {step} effect, flow free; χ² removed over {second.inflation:.1f} (correlated hours):")
        for label, gain in second.removed.items():
            own = second.fits[label].hypothesis.effects[-1]
            values = ", ".join(f"{n} = {second.fits[label].theta[n]:.3g}" for n in own.amplitudes)
            z = next(b.z_blocks for b in second.scores if b.effect.label == label)
            print(f"   {label:36s} {gain:7.1f}   z of ten-day blocks {z:5.1f}   {values}")
        gains = list(second.removed.values())
        if gains[0] < gains[1] + SEPARATED:
            print("   no name: the first two are not separated")
        rest = [
            f"{b.effect.label} ({'wrong sign, ' * (not b.feasible)}{100 * b.share:.1f} % left)"
            for b in second.scores
            if not b.rankable and b.effect.label in TOLD
        ]
        print(f"   not ranked: {', '.join(rest)}")
        fit = second.fits[next(iter(second.removed))]
        if number == 5:
            print(f"   with the first, in 2012 from CDP alone:\n   {told(uci.predicted(fit, unseen, ('P3_Pa',)))}")
    for regime in uci.REGIMES:
        [alone] = uci.load_years(2011, thin=FIT_THIN // 2, regime=regime)
        print(f"   {regime} alone: κ = {uci.vanes(alone, uci.COMPUTED).theta[uci.KAPPA]:.2f}")


def humidity() -> None:
    print(
        "7. Humidity, withheld: coefficient of the column if it is given (1 if it were seen), correlation of the "
        "hidden estimate with it, share absorbed"
    )
    for regime in ("", *uci.REGIMES):
        h = uci.humidity_check(regime, FIT_THIN)
        print(f"   {regime or 'all hours'}: {h.coefficient:.2f}, {h.correlation:+.2f}, {100 * h.absorbed:.1f} %")


def main() -> None:
    located()
    without_vanes()
    train, unseen = uci.load_years(2011, 2012, thin=FIT_THIN)
    beside(train, unseen, hidden(train, unseen))
    humidity()


if __name__ == "__main__":
    main()
