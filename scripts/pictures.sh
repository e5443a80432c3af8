#!/usr/bin/env bash
# Makes the pictures of the README and the documents in doc/images from real frames (../shared/data/kitti_00, or the folder given).
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
data=$(realpath "${1:-$root/../shared/data/kitti_00}")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

"$root/bootstrap" run dataset_to_bag "$data" --every 2 --perturb 2 0.1 --seed 4 --out "$work/kitti.bag"
"$root/bootstrap" run calibrate_bag "$work/kitti.bag" --min-frames 10 --reference "$work/kitti.truth.yaml" \
  --set search_range/rotation_deg=3 --set search_range/translation_m=0.1 \
  --out "$work/result.yaml" --overlay "$work/overlay.png"
/usr/bin/python3 - "$work/overlay.png" "$root/doc/images/before_after.jpg" <<'EOF'
import cv2, sys
cv2.imwrite(sys.argv[2], cv2.imread(sys.argv[1]), [cv2.IMWRITE_JPEG_QUALITY, 85])
EOF
echo "wrote $root/doc/images/before_after.jpg"
