// The report's style sheet: light and dark, wide and narrow, on screen and on paper; no resources from elsewhere.
#pragma once

namespace countershade::tools {

inline constexpr const char* kReportStyle = R"css(
:root{color-scheme:light dark;--ink:#1b1e22;--soft:#5f656d;--paper:#f7f6f3;--card:#fff;--line:#dedbd5;--good:#24754a;
--bad:#b03a2e;--warn:#8a5a00;--warn-back:#fdf4dc;--plain:#b8651b;--comp:#2068b0;--target:#2b2f35;--band:#8884}
@media(prefers-color-scheme:dark){:root{--ink:#e7e5e0;--soft:#a0a5ac;--paper:#15171a;--card:#1d2023;--line:#363a40;
--good:#2f8f5c;--bad:#c9503f;--warn:#e8c069;--warn-back:#2d2717;--plain:#e0924c;--comp:#62a5e8;--target:#d8dade;--band:#8883}}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);
font:16px/1.55 system-ui,-apple-system,"Segoe UI",Roboto,"Noto Sans","DejaVu Sans",sans-serif}
main{max-width:1200px;margin:0 auto;padding:32px 24px 64px}
h1{font-size:1.75rem;line-height:1.25;margin:0;letter-spacing:-.01em}
h2{font-size:1.2rem;margin:44px 0 4px;letter-spacing:-.005em}
h3{font-size:1rem;margin:0 0 8px}
p{margin:6px 0}
.lead{color:var(--soft);margin:2px 0 14px;max-width:76ch}
header{display:flex;gap:20px;align-items:center;flex-wrap:wrap}
header div{flex:1 1 320px}
.badge{color:#fff;font-weight:700;font-size:1.35rem;letter-spacing:.05em;border-radius:10px;padding:8px 22px}
.badge.pass{background:var(--good)}.badge.fail{background:var(--bad)}
.small{color:var(--soft);font-size:.88rem}
.cards{display:grid;gap:14px;grid-template-columns:repeat(auto-fit,minmax(235px,1fr));margin:22px 0 0}
.card{background:var(--card);border:1px solid var(--line);border-top:4px solid var(--line);border-radius:10px;
padding:14px 18px}
.card.pass{border-top-color:var(--good)}.card.fail{border-top-color:var(--bad)}
.card b{display:block;font-size:1.65rem;line-height:1.25;font-weight:650;font-variant-numeric:tabular-nums}
.card .what{font-size:.92rem}.card .bound{font-size:.84rem;color:var(--soft)}
.card.fail .bound{color:var(--bad);font-weight:600}
.box{border-left:4px solid var(--bad);background:var(--card);border-radius:6px;padding:10px 16px;margin:16px 0 0}
.box.warn{border-left-color:var(--warn);background:var(--warn-back)}
.box ul{margin:4px 0;padding-left:20px}
.grid3{display:grid;gap:16px;grid-template-columns:repeat(auto-fit,minmax(min(300px,100%),1fr))}
.grid2{display:grid;gap:20px;grid-template-columns:repeat(auto-fit,minmax(min(440px,100%),1fr));align-items:start}
figure{margin:0}
figure img{width:100%;height:auto;display:block;border-radius:6px;border:1px solid var(--line)}
figcaption{font-size:.9rem;color:var(--soft);padding:6px 2px 0}
figcaption b{color:var(--ink);font-weight:650}
.panel{background:var(--card);border:1px solid var(--line);border-radius:10px;padding:14px 16px;margin-top:14px;
min-width:0}
.scroll{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-size:.93rem;font-variant-numeric:tabular-nums}
th,td{text-align:left;vertical-align:top;padding:6px 14px 6px 0;border-bottom:1px solid var(--line)}
tr:last-child td{border-bottom:0}
th{color:var(--soft);font-weight:600;font-size:.86rem}
.numbers th,.numbers td{text-align:right;white-space:nowrap}
.numbers td.words{text-align:left;white-space:normal;min-width:14rem}
.numbers th:first-child,.numbers td:first-child{text-align:left;white-space:normal;min-width:150px}
.numbers .zone td{font-weight:650;padding-top:14px;text-align:left}
.numbers .shown td:nth-child(n+2){color:var(--comp);font-weight:600}
svg{width:100%;height:auto;display:block}
.legend{max-width:420px;margin:6px 0 2px}
.tick{font-size:12px;fill:var(--soft)}.axis{font-size:13px;fill:var(--ink)}
.grid{stroke:var(--line);stroke-width:.8}.frame{stroke:var(--soft);stroke-width:1}.band{fill:var(--band)}
details summary{cursor:pointer;color:var(--soft)}
footer{margin-top:48px;padding-top:14px;border-top:1px solid var(--line);color:var(--soft);font-size:.88rem;max-width:90ch}
@media(max-width:560px){main{padding:20px 14px 40px}.card b{font-size:1.4rem}h2{margin-top:32px}.panel{padding:10px 10px}
.plot .tick{font-size:15px}.plot .axis{font-size:16px}}
@media print{body{background:#fff}.panel,figure,.card{break-inside:avoid}}
)css";

}  // namespace countershade::tools
