#include "style.hpp"

namespace lidar_camera_recalibration {

const char* const kReportStyle = R"css(
:root { --ink: #1b2430; --soft: #5b6675; --line: #dde2e8; --card: #f6f8fa; --blue: #1d5fa8; --orange: #c2540a;
        --good: #18794e; --good-soft: #e8f5ee; --bad: #b42318; --bad-soft: #fdecea; }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0; background: #fff; color: var(--ink); font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto,
       "Helvetica Neue", Arial, sans-serif; -webkit-print-color-adjust: exact; print-color-adjust: exact; }
main { max-width: 1040px; margin: 0 auto; padding: 28px 24px 64px; }
h1 { font-size: 26px; line-height: 1.2; margin: 0 0 4px; letter-spacing: -0.01em; }
h2 { font-size: 20px; margin: 44px 0 6px; padding-top: 16px; border-top: 1px solid var(--line); letter-spacing: -0.01em; }
h3 { font-size: 15px; margin: 22px 0 6px; }
p { margin: 0 0 12px; }
.soft { color: var(--soft); font-size: 14px; overflow-wrap: anywhere; }
.verdict { margin: 18px 0; padding: 14px 18px; border-radius: 10px; border-left: 6px solid; overflow-wrap: anywhere; }
.verdict b { display: block; font-size: 20px; }
.accepted { background: var(--good-soft); border-color: var(--good); }
.accepted b { color: var(--good); }
.rejected { background: var(--bad-soft); border-color: var(--bad); }
.rejected b { color: var(--bad); }
.tiles { display: grid; grid-template-columns: repeat(4, 1fr); gap: 12px; margin: 18px 0; }
.tile { background: var(--card); border-radius: 10px; padding: 12px 14px; }
.tile .label { color: var(--soft); font-size: 13px; }
.tile .value { font-size: 22px; font-weight: 650; line-height: 1.25; font-variant-numeric: tabular-nums; }
.tile .more { color: var(--soft); font-size: 13px; }
figure { margin: 0; }
.legend { max-width: 420px; margin: 10px 0 16px; font-size: 13px; color: var(--soft); }
.legend .ramp { height: 12px; border-radius: 6px; }
.legend .ticks { display: flex; justify-content: space-between; font-variant-numeric: tabular-nums; }
.pair { margin: 0 0 22px; break-inside: avoid; }
.pair .shot, .zoom .shot { position: relative; }
.pair img, .zoom img { display: block; width: 100%; height: auto; }
.pair .shot:first-child img { border-radius: 8px 8px 0 0; }
.pair .shot:nth-child(2) img { border-radius: 0 0 8px 8px; }
.tag { position: absolute; left: 8px; top: 8px; padding: 1px 8px; border-radius: 5px; font-size: 13px; font-weight: 600;
       color: #fff; background: rgba(20, 26, 34, 0.78); }
.after .tag { background: var(--blue); }
figcaption { color: var(--soft); font-size: 13px; padding: 6px 2px 0; }
figcaption b { color: var(--ink); }
.zooms { display: grid; grid-template-columns: repeat(2, 1fr); gap: 18px; }
.zoom { break-inside: avoid; }
.zoom .both { display: grid; grid-template-columns: 1fr 1fr; gap: 3px; }
.zoom .shot:first-child img { border-radius: 8px 0 0 8px; }
.zoom .shot:nth-child(2) img { border-radius: 0 8px 8px 0; }
.slices { display: grid; grid-template-columns: repeat(3, 1fr); gap: 16px 20px; margin-top: 12px; }
.slice { break-inside: avoid; }
.slice svg { display: block; width: 100%; height: auto; background: var(--card); border-radius: 8px; }
.slice text { font: 10px system-ui, sans-serif; fill: var(--soft); font-variant-numeric: tabular-nums; }
.slice .startText { fill: var(--orange); paint-order: stroke; stroke: var(--card); stroke-width: 4px; }
.slice .grid { stroke: var(--line); }
.slice .curve { fill: none; stroke: var(--blue); stroke-width: 1.8; stroke-linejoin: round; }
.slice .sigma { fill: var(--blue); opacity: 0.16; }
.slice .result { stroke: var(--blue); stroke-width: 1; }
.slice .start { stroke: var(--orange); stroke-width: 1.2; stroke-dasharray: 4 3; }
table { border-collapse: collapse; width: 100%; font-size: 15px; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 6px 14px 6px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
th { color: var(--soft); font-weight: 600; font-size: 13px; }
td:last-child, th:last-child { padding-right: 0; }
tr { break-inside: avoid; }
.mark { width: 26px; font-weight: 700; }
.yes { color: var(--good); }
.no { color: var(--bad); }
.numbers td:last-child { white-space: pre-wrap; }
.scroll { overflow-x: auto; break-inside: avoid; }
.paste { break-inside: avoid; }
pre { background: var(--card); border-radius: 8px; padding: 12px 14px; margin: 0 0 8px; overflow-x: auto;
      font: 12.5px/1.5 ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; }
code { font-family: ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; font-size: 0.92em; white-space: nowrap; }
@media (max-width: 720px) {
  main { padding: 18px 14px 40px; }
  h1 { font-size: 22px; }
  .tiles { grid-template-columns: 1fr 1fr; gap: 8px; }
  .tile .value { font-size: 19px; }
  .zooms { grid-template-columns: 1fr; }
  .slices { grid-template-columns: 1fr; }
  .tag { left: 5px; top: 5px; font-size: 11px; padding: 0 6px; }
  table { font-size: 14px; }
  pre { font-size: 10.5px; padding: 10px; }
  th, td { padding-right: 8px; }
}
@media print {
  @page { size: A4; margin: 14mm 13mm; }
  body { font-size: 10.5pt; }
  main { max-width: none; padding: 0; }
  h2 { margin-top: 22px; break-after: avoid; }
  h3 { break-after: avoid; }
  .tiles { grid-template-columns: repeat(4, 1fr); }
  .zooms { grid-template-columns: 1fr 1fr; }
  .slices { grid-template-columns: repeat(3, 1fr); }
  table { font-size: 9.5pt; }
  pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: 8pt; }
}
)css";

}  // namespace lidar_camera_recalibration
