#!/bin/bash
# Perform every step of the Dockerfile, and run the services of compose.yaml from what it makes, without a container
# engine: buildah with chroot isolation on a debootstrapped Debian, then processes in namespaces of their own.
#
# usage: docker/prove.sh [WORK_DIRECTORY]       root on Debian; minutes, and some 6 GB; README.md tells what was seen
#
# Prints what was run, and at the end what was not.  KEEP=1 leaves the image in buildah's storage.
set -euo pipefail
cd "$(dirname "$0")/.."
work=${1:-/var/tmp/tailstack-prove}
base=localhost/python:3.11-slim-bookworm
image=localhost/tailstack:prove
mirror=${DEBIAN_MIRROR:-http://deb.debian.org/debian}
export DEBIAN_FRONTEND=noninteractive BUILDAH_ISOLATION=chroot

say() { printf '\n== %s\n' "$*"; }

[ "$(id -u)" = 0 ] && [ -e /etc/debian_version ] || { echo "prove.sh: root on Debian is needed" >&2; exit 2; }
missing=
for pair in buildah:buildah debootstrap:debootstrap nginx:nginx-light ip:iproute2 curl:curl python3:python3; do
  command -v "${pair%%:*}" > /dev/null || missing="$missing ${pair##*:}"
done
ls /usr/lib/postgresql/*/bin/postgres > /dev/null 2>&1 || missing="$missing postgresql"
if [ -n "$missing" ]; then
  apt-get update -qq
  # shellcheck disable=SC2086
  apt-get install -yqq --no-install-recommends $missing < /dev/null > /dev/null
fi
mkdir -p "$work"

if buildah inspect --type image "$base" > /dev/null 2>&1; then
  say "base image: $base, made before"
else
  say "base image: bookworm by debootstrap with Debian's Python, in place of python:3.11-slim-bookworm"
  debootstrap --variant=minbase --include=ca-certificates,python3.11,python3.11-venv,python3-pip bookworm "$work/base" "$mirror" > "$work/debootstrap.log"
  rm -rf "$work/base/var/cache/apt/archives" "$work/base/var/lib/apt/lists"
  for name in python python3; do ln -sf /usr/bin/python3.11 "$work/base/usr/local/bin/$name"; done
  container=$(buildah from scratch)
  buildah add -q "$container" "$work/base" / > /dev/null
  buildah config --env PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$container"
  buildah commit -q "$container" "$base" > /dev/null
  buildah rm "$container" > /dev/null
  rm -rf "$work/base"
fi

say "docker/Dockerfile, every step, by buildah"
# How this machine reaches a package index is its own business: pip's configuration and what it names are lent
lent=()
for file in /etc/pip.conf /etc/ssl/certs/ca-certificates.crt; do [ -e "$file" ] && lent+=(-v "$file:$file:ro"); done
for path in $(grep -oE '(file://)?/[A-Za-z0-9/._-]+' /etc/pip.conf 2> /dev/null | sed 's,^file://,,'); do
  top=/$(echo "$path" | cut -d/ -f2-3)
  [ -d "$path" ] && [[ " ${lent[*]} " != *" $top:$top:ro "* ]] && lent+=(-v "$top:$top:ro")
done
began=$SECONDS
buildah bud --format docker --isolation chroot ${LAYERS:+--layers} --build-arg BASE="$base" \
  --build-arg REVISION="$(git rev-parse HEAD 2> /dev/null || echo unknown)" "${lent[@]}" \
  -f docker/Dockerfile --ignorefile .dockerignore -t "$image" . > "$work/build.log" 2>&1 || { tail -40 "$work/build.log"; exit 1; }
grep -E '^(\[[12]/2\] )?STEP|^kernels' "$work/build.log" | cut -c1-150
echo "built in $((SECONDS - began)) s"

container=$(buildah from "$image")
finish() {
  buildah umount "$container" > /dev/null 2>&1 || true
  buildah rm "$container" > /dev/null 2>&1 || true
  [ -n "${KEEP:-}" ] || buildah rmi "$image" > /dev/null 2>&1 || true
}
trap finish EXIT
buildah inspect --type image "$image" > "$work/image.json"
root=$(buildah mount "$container")
python3 docker/prove.py "$root" "$work"
