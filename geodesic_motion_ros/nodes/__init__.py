"""The ROS 2 face: the nodes `planner`, `twin`, `record`. Beside it demo, paper and studies import rclpy."""

import os

# A control loop shares its cores with DDS and the simulator. Worker threads of BLAS or OpenMP gain nothing on
# matrices of this size and preempt the loop; the pools read these variables once, when numpy is first
# imported.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

# A publisher that writes to shared memory waits up to a third of a second, and the interpreter with it, when another
# program joins (Fast DDS checks the newcomer's port meanwhile, eProsima/Fast-DDS#6535). Clouds arrive as well by UDP,
# where a socket holds one: the kernel allows as much as net.core.rmem_max.
os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4?sockets_size=4MB")
