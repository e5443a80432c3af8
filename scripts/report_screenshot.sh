#!/usr/bin/env bash
# Makes doc/images/report.jpg: the page of calibrate_bag --report on a wide screen and on a phone. Needs Chromium.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
command -v chromium >/dev/null || { echo "chromium is missing: apt-get install chromium" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"$root/bootstrap" run simulate_drive drive.bag --frames 20 --rate 1 --perturb 2 0.1 --seed 3
"$root/bootstrap" run calibrate_bag drive.bag --report report.html

shoot() {  # PAGE SIZE PICTURE
  chromium --headless --no-sandbox --disable-gpu --hide-scrollbars --user-data-dir="$work/profile" \
    --allow-file-access-from-files --disable-background-networking --window-size="$2" --screenshot="$3" \
    "file://$work/$1" >/dev/null 2>&1
}
# Chromium's windows are never as narrow as a phone.
echo '<body style="margin:0"><iframe src="report.html" style="border:0;width:390px;height:9000px"></iframe>' >phone.html
shoot report.html 1100,6600 wide.png
shoot phone.html 500,9000 phone.png
/usr/bin/python3 - "$root/doc/images/report.jpg" <<'PYTHON'
import sys

import cv2
import numpy as np

wide, phone = cv2.imread("wide.png"), cv2.imread("phone.png")[:, :390]
height, gap = 1500, 30
page = np.full((height, 2 * 1100 + 390 + 2 * gap, 3), 225, np.uint8)
page[:, :1100] = wide[:height]
page[:, 1100 + gap:2200 + gap] = wide[3300:3300 + height]
page[:, 2200 + 2 * gap:] = phone[:height]
page = cv2.resize(page, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA)
cv2.imwrite(sys.argv[1], page, [cv2.IMWRITE_JPEG_QUALITY, 62])
PYTHON
