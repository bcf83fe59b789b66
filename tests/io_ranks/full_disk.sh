#!/bin/sh
# SPDX-License-Identifier: GPL-3.0-or-later
# full_disk.sh COMMAND...: runs `COMMAND... full-disk FOLDER`, FOLDER being a file system of 2 MB of its own.
# Exit code 0: the command said that all is right; 77: such a file system is not allowed here.
folder=$(mktemp -d) || exit 1
trap 'rmdir "$folder"' EXIT
if [ "$(id -u)" = 0 ]; then map=; else map=-r; fi
unshare $map -m true 2>/dev/null || exit 77
unshare $map -m /bin/sh -c 'folder=$1; shift; mount -t tmpfs -o size=2m none "$folder" || exit 77
said=$("$@" full-disk "$folder" 2>&1)
case $said in *"full disk: all as it should be"*) exit 0 ;; esac
printf "%s\n" "$said" >&2; exit 1' sh "$folder" "$@"
