#!/bin/sh
# Chooses the kernels that this processor can run, and puts them where they may be added to: the image itself is read-only.
set -eu
if [ -z "${NUMBA_CPU_NAME:-}" ]; then
    if grep -qw avx2 /proc/cpuinfo && grep -qw fma /proc/cpuinfo; then NUMBA_CPU_NAME=haswell; else NUMBA_CPU_NAME=generic; fi
fi
export NUMBA_CPU_NAME
export NUMBA_CACHE_DIR="${NUMBA_CACHE_DIR:-/tmp/orthomill-kernels}"
if [ ! -d "$NUMBA_CACHE_DIR" ] && [ -d /opt/orthomill/kernels ]; then
    cp -r --preserve=timestamps /opt/orthomill/kernels "$NUMBA_CACHE_DIR"
fi
# Pods of a cluster start its scheduler and its workers with the same kernels.
if [ "${1:-}" = dask ]; then exec "$@"; fi
exec orthomill "$@"
