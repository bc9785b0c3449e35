"""Between turbid and HyperQueue's Python package: one request (JSON) on stdin, one answer (JSON) on stdout.

Written by turbid; of no use without it.
"""

import json
import sys


def answer(**said):
    print(json.dumps(said))
    sys.exit(0)


def in_short(error):
    """The package's errors carry a backtrace of many pages."""
    text = str(error).split("Stack backtrace", 1)[0]
    return "; ".join(line.strip() for line in text.splitlines() if line.strip() not in ("", "Caused by:"))


class Seen(Exception):
    """Waiting ends here: how the job stands was all that was asked."""


def submit(client, request):
    from hyperqueue.ffi.protocol import ResourceRequest
    from hyperqueue.job import Job

    # No failed task takes the others with it.
    job = Job(name=request["name"], max_fails=None)
    for shard in request["shards"]:
        job.program(
            ["sh", request["script"], str(request["round"]), str(shard)],
            name=str(shard),
            cwd=request["cwd"],
            stdout=None,
            stderr=None,
            resources=ResourceRequest(cpus=request["threads"]),
        )
    answer(id=client.submit(job).id)


def look(client, job):
    stands = {}

    def seen(jobs):
        stands.update(jobs.get(job) or {})
        raise Seen

    try:
        client.connection.wait_for_jobs([job], seen)
    except Seen:
        pass
    if not stands:
        answer(unknown=True)
    failed = client.connection.get_failed_tasks([job]).get(job, {})
    errors = {str(task): context.error for task, context in failed.items()}
    answer(completed=stands["completed"], finished=stands["finished"], total=stands["total"], failed=errors)


def main():
    request = json.load(sys.stdin)
    try:
        from hyperqueue.client import Client
    except ImportError as error:
        answer(error="absent", text=f"{sys.executable}: {error}")
    try:
        client = Client(request["server"])
    except Exception as error:
        answer(error="silent", text=in_short(error))
    try:
        if "job" in request:
            look(client, request["job"])
        submit(client, request)
    # The package's own mistakes are no `Exception`s.
    except BaseException as error:
        if isinstance(error, SystemExit):
            raise
        answer(error="refused", text=in_short(error))


main()
