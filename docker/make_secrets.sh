#!/bin/sh
# Make the secret files that the profile "cluster" mounts.  What is there is kept.
# The directory is for its owner only; the files are readable in the containers, which run under other users.
set -eu
directory=${SECRETS:-$(dirname "$0")/secrets}
mkdir -p "$directory"
chmod 700 "$directory"
if [ -e "$directory/postgres_password" ]; then
  echo "$directory/postgres_password is there already" >&2
else
  password=$(od -An -N24 -tx1 /dev/urandom | tr -d ' \n')
  printf '%s' "$password" > "$directory/postgres_password"
  printf '[tailstack]\nhost=postgres\nport=5432\ndbname=tailstack\nuser=tailstack\npassword=%s\n' "$password" \
    > "$directory/pg_service.conf"
  chmod 644 "$directory/postgres_password" "$directory/pg_service.conf"
  echo "made $directory/postgres_password and $directory/pg_service.conf" >&2
fi
