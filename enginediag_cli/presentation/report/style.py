"""How a report looks: light and dark as the reader's system asks, on a phone, on paper. No font and no picture is
fetched from anywhere."""

from __future__ import annotations

from enginediag_cli.presentation.charts.palette import pairs

_BASE = """
:root{color-scheme:light dark;--paper:#ffffff;--ink:#1f2933;--quiet:#52606d;--line:#d5dbe1;--soft:#f5f7fa;
--link:#1c5aa0;--changed:#b23c00;--cannot:#7a5b00;--silent:#52606d;--fine:#0b6b34}
@media (prefers-color-scheme:dark){:root{--paper:#1b222b;--ink:#e4e7eb;--quiet:#a6b1bd;--line:#3e4c59;--soft:#232c37;
--link:#7db4ee;--changed:#ff9a5c;--cannot:#e6c34a;--silent:#a6b1bd;--fine:#63c98a}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,
"Helvetica Neue",Arial,sans-serif}
main,header,footer{max-width:1060px;margin:0 auto;padding:0 20px}
header{padding-top:26px}
h1{font-size:1.55rem;line-height:1.25;margin:0 0 .3rem}
h2{font-size:1.25rem;margin:2.6rem 0 .6rem;padding-top:.6rem;border-top:1px solid var(--line)}
h3{font-size:1.05rem;margin:1.8rem 0 .4rem}
p{margin:.5rem 0;max-width:75ch}
a{color:var(--link)}
.quiet{color:var(--quiet);font-size:.92rem}
.skip{position:absolute;left:-999px}.skip:focus{left:8px;top:8px;background:var(--paper);padding:6px 10px;z-index:9}
:focus-visible{outline:3px solid var(--link);outline-offset:2px}
.lead{border:1px solid var(--line);border-left:6px solid var(--silent);border-radius:6px;background:var(--soft);
padding:16px 20px;margin:14px 0}
.lead.changed{border-left-color:var(--changed)}.lead.cannot{border-left-color:var(--cannot)}
.lead.fine{border-left-color:var(--fine)}
.lead .state{font-weight:700;font-size:.86rem;color:var(--silent)}
.lead.changed .state{color:var(--changed)}.lead.cannot .state{color:var(--cannot)}.lead.fine .state{color:var(--fine)}
.lead .verdict{font-size:1.25rem;line-height:1.35;font-weight:600;margin:.15rem 0 .7rem;max-width:60ch}
.lead dl{display:grid;grid-template-columns:max-content 1fr;gap:.3rem 1.1rem;margin:0}
.lead dt{color:var(--quiet);font-size:.95rem}.lead dd{margin:0;max-width:72ch}
nav ul{display:flex;flex-wrap:wrap;gap:.2rem 1.2rem;padding:0;margin:.8rem 0;list-style:none}
figure{margin:1.2rem 0 1.8rem}
figcaption{margin-bottom:.4rem}figcaption strong{font-size:1.05rem}
figcaption span{display:block;color:var(--quiet);font-size:.92rem;max-width:90ch}
.drawn{overflow-x:auto}
.drawn svg{display:block;width:100%;min-width:560px;height:auto;max-width:900px}
.live{max-width:900px}
.legend{display:flex;flex-wrap:wrap;gap:.2rem .4rem;margin:.2rem 0 .3rem}
.legend button{font:inherit;font-size:.88rem;color:var(--ink);background:none;border:1px solid transparent;
border-radius:4px;padding:.1rem .45rem;cursor:pointer;text-align:left}
.legend button:hover{border-color:var(--line)}
.legend button[aria-pressed=false]{opacity:.45;text-decoration:line-through}
.swatch{display:inline-block;width:.75em;height:.75em;border-radius:50%;margin-right:.45em}.drawn.instead{display:none}
caption{text-align:left;padding:.2rem .7rem}
details{margin:.4rem 0}summary{cursor:pointer;color:var(--link)}
.scroll{overflow:auto;max-height:26rem;border:1px solid var(--line);margin:.4rem 0}
.scroll.open{max-height:none}
table{border-collapse:collapse;font-size:.88rem;font-variant-numeric:tabular-nums}
th,td{padding:.22rem .7rem;text-align:left;border-bottom:1px solid var(--line);white-space:nowrap;vertical-align:top}
td.w{white-space:normal;min-width:16rem}
th{position:sticky;top:0;background:var(--soft)}
.n{text-align:right}
pre{background:var(--soft);border:1px solid var(--line);padding:.7rem .9rem;overflow-x:auto;font-size:.84rem;
white-space:pre-wrap;overflow-wrap:anywhere}
.find{margin:.3rem 0}.find input{font:inherit;padding:.2rem .5rem;max-width:100%}
@media (max-width:600px){main,header,footer{padding:0 12px}.lead{padding:12px 14px}
.lead dl{grid-template-columns:1fr;gap:.1rem}.lead dd{margin-bottom:.5rem}.lead .verdict{font-size:1.1rem}
h1{font-size:1.3rem}}
@media print{:root{--paper:#fff;--ink:#000;--quiet:#444;--line:#bbb;--soft:#fff;--link:#000}
body{font-size:10.5pt}nav,.skip,.find,.live{display:none!important}.drawn{display:block!important;overflow:visible}
figure,.lead{break-inside:avoid}h2,h3{break-after:avoid}details:not([open]){display:none}
.drawn svg{min-width:0;max-width:100%}.scroll{max-height:none;overflow:visible;border:0}
th{position:static}td,th{white-space:normal}td.w{min-width:0}.lead>a{display:none}a{text-decoration:none}}
"""


def style() -> str:
    """The sheet of a page, with the colours of its pictures in the dark."""
    rules = "".join(
        f'.drawn svg[{what}="{light}"],.drawn svg [{what}="{light}"]{{{what}:{dark}}}'
        for light, dark in pairs()
        for what in ("fill", "stroke")
    )
    return f"{_BASE.strip()}\n@media screen and (prefers-color-scheme:dark){{{rules}}}\n"
