"""A HyperQueue server, or a worker of one, from the Python package alone: `server FOLDER`, `worker FOLDER OWN_FOLDER`.

For trying things out on one machine; on a cluster use `hq server start` and `hq worker start`. Each is a process of its
own, so that it can be ended without the others. The package starts workers beside their server only: a worker's process
therefore starts a server of its own that nobody uses, and is then shown to the other one.
"""

import os
import signal
import sys

from hyperqueue.cluster import LocalCluster, WorkerConfig

role, folder = sys.argv[1], os.path.abspath(sys.argv[2])
if role == "server":
    cluster = LocalCluster(server_dir=folder)
else:
    own = os.path.abspath(sys.argv[3])
    cluster = LocalCluster(server_dir=own)
    shown = os.path.join(own, "hq-current")
    os.remove(shown)
    os.symlink(os.path.realpath(os.path.join(folder, "hq-current")), shown)
    cluster.start_worker(WorkerConfig(cores=1))
print("ready", flush=True)
signal.sigwait([signal.SIGTERM, signal.SIGINT])
os._exit(0)
