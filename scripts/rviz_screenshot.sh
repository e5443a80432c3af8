#!/usr/bin/env bash
# Makes doc/images/rviz.jpg: the demonstration in rviz, on a display that exists in memory only.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
picture=$(realpath -m "${1:-$root/doc/images/rviz.jpg}")
mkdir -p "$(dirname "$picture")"
for tool in xvfb-run xauth scrot; do
  command -v "$tool" >/dev/null ||
    { echo "$tool is missing: apt-get install xvfb xauth scrot libgl1-mesa-dri" >&2; exit 1; }
done

if [ -z "${RVIZ_SCREENSHOT_INSIDE:-}" ]; then
  # The screen is as large as the window in config/recalibration.rviz.
  export RVIZ_SCREENSHOT_INSIDE=1 LIBGL_ALWAYS_SOFTWARE=1 QT_X11_NO_MITSHM=1
  exec xvfb-run --auto-servernum --server-args="-screen 0 1600x960x24 +extension GLX -noreset" "$0" "$picture"
fi

work=$(mktemp -d)
export XDG_RUNTIME_DIR=$work
: >"$work/log"
"$root/bootstrap" demo --rviz >"$work/log" 2>&1 &
demo=$!
trap 'kill "$demo" 2>/dev/null && wait "$demo"; rm -rf "$work"' EXIT
until grep -q "rviz stays open" "$work/log"; do
  kill -0 "$demo" 2>/dev/null || { cat "$work/log" >&2; exit 1; }
  sleep 1
done
sleep "${DELAY:-12}"  # the drive starts again after the result: clouds, frames and overlay of both
scrot --overwrite --quality 85 "$picture"
echo "wrote $picture ($(($(stat -c %s "$picture") / 1000)) kB)"
