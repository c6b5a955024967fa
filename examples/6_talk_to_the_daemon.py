"""Ask a running daemon for friction.

The daemon is started here on the simulated rig; usually one runs all day, and a script begins at `HapticClient`.
Whatever ends the inner block, an error or Ctrl-C too, leaves the output off.
"""

import json
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from haptic_driver.client import HapticClient

with TemporaryDirectory() as folder:
    socket = Path(folder) / "daemon.sock"
    haptic = Path(sys.executable).with_name("haptic")
    command = [str(haptic), "daemon", "run", "--rig", "simulated", "--socket", str(socket), "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as daemon:
        assert daemon.stdout is not None
        print(f"ready at {Path(json.loads(daemon.stdout.readline())['socket']).name}")
        try:
            with HapticClient(socket) as client, client.armed(lease_s=5.0) as session:
                session.set(0.6)
                time.sleep(0.5)
                status = client.status()
                print(f"{status.state} at {status.voltage_v} V, simulated: {status.simulated}")
            with HapticClient(socket) as client:
                print(f"output on: {client.status().output_on}")
        finally:
            daemon.terminate()
