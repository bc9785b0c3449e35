#!/usr/bin/env bash
# A store in S3 against moto, which speaks like S3 and checks signatures and rights here. pip installs it into a virtual
# environment of its own.
# usage: TURBID=turbid [KILLS=20] bash moto.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
MOTO=${MOTO:-5.2.5}
python "moto[server,s3]==$MOTO"
port=$(free_port)
export AWS_ENDPOINT_URL=http://127.0.0.1:$port
# The three requests that make a user with keys go unsigned; all others must be signed by it.
INITIAL_NO_AUTH_ACTION_COUNT=3 begin moto venv/bin/moto_server -H 127.0.0.1 -p "$port"
answers "$AWS_ENDPOINT_URL/moto-api/"
keys=$(AWS_ACCESS_KEY_ID=any AWS_SECRET_ACCESS_KEY=any client keys)
read -r AWS_ACCESS_KEY_ID AWS_SECRET_ACCESS_KEY <<< "$keys"
export AWS_ACCESS_KEY_ID AWS_SECRET_ACCESS_KEY
client bucket turbid-check
echo "moto $MOTO at $AWS_ENDPOINT_URL"
check turbid-check
