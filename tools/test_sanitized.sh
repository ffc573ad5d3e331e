#!/bin/sh
# Build the native core with AddressSanitizer, UBSan and Eigen's assertions, and run its tests with that.
set -eu
tree=build/sanitized/tree
flags="-fsanitize=address,undefined -fno-sanitize-recover=undefined -fno-omit-frame-pointer -UNDEBUG"
# Functions that inline all they call, [[gnu::flatten]], would take many minutes to compile so.
flags="$flags -Dflatten=unused"
CFLAGS="$flags" CXXFLAGS="$flags" LDFLAGS="$flags" \
    python3 setup.py -q build --build-base build/sanitized --build-lib "$tree"
rm -rf "$tree/test" "$tree/paper"
cp -r test paper pyproject.toml "$tree"
cd "$tree"
# Python itself is not built with it, so that the library must be there first; leaks of Python are not ours.
export LD_PRELOAD="$(g++ -print-file-name=libasan.so) $(g++ -print-file-name=libstdc++.so)"
export ASAN_OPTIONS=detect_leaks=0
exec python3 -m pytest -q -p no:cacheprovider "${@:-test/native}"
