# The twins have the same signatures; here all arguments are by position.
from plsing_ros.kernels.of_numpy import *  # noqa: F403
