"""A ROS 2 node: spikes of touch afferents from the force of a fingertip sensor.

It subscribes to ``wrench`` (`geometry_msgs/WrenchStamped`) and publishes ``spikes``
(`std_msgs/Float64MultiArray`): a row for each spike, with its ROS time in s, its class (0 SA, 1 RA,
2 PC) and its cell (0 is the most sensitive). Needs rclpy, fembridge and NumPy::

    fembridge calibrate press.csv --force-n 0.05
    python3 wrench_to_spikes.py --ros-args -p calibration:=calibration.toml -r wrench:=/ft_sensor

Messages come at uneven times, the encoder takes even samples: the force is interpolated linearly on
a grid of ``sensor_ms``. After a gap, or when time runs back, the afferents begin anew.
"""

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

import fembridge as fb
from neural import Stream

CLASSES = ("SA", "RA", "PC")
FIELDS = 3
LONGEST_GAP_S = 0.1


class WrenchToSpikes(Node):
    """Spikes of one fingertip.

    The ROS parameters are ``calibration`` (file of `fembridge calibrate`), ``axis`` (``x``, ``y``
    or ``z`` of the force, default ``z``) and ``sensor_ms`` (grid in ms, default 1).
    """

    def __init__(self) -> None:
        super().__init__("wrench_to_spikes")
        path = self.declare_parameter("calibration", "calibration.toml").value
        self.axis = self.declare_parameter("axis", "z").value
        self.step_s = self.declare_parameter("sensor_ms", 1.0).value / 1000
        self.calibration = fb.Calibration.read(path)
        parameters = self.calibration.parameters or "fitted"
        classes = list(self.calibration.gain_pa)
        self.stream = Stream(parameters, 1000 * self.step_s, afferents=classes)
        self.last: tuple[float, float] | None = None  # time in s and force in N of a message
        self.start_s = 0.0  # time of the first sample
        self.publisher = self.create_publisher(Float64MultiArray, "spikes", 10)
        self.create_subscription(WrenchStamped, "wrench", self.receive, qos_profile_sensor_data)

    def receive(self, message: WrenchStamped) -> None:
        """Encode the force since the last message, and publish its spikes."""
        stamp = message.header.stamp
        time_s = stamp.sec + 1e-9 * stamp.nanosec
        force_n = getattr(message.wrench.force, self.axis)
        if self.last is None or not 0 < time_s - self.last[0] <= LONGEST_GAP_S:
            self.stream.reset()
            self.start_s, samples = time_s, [force_n]
        else:
            samples = self.between(*self.last, time_s, force_n)
        self.last = time_s, force_n
        spikes = self.stream.push(self.calibration.stress_pa(samples))
        if spikes:
            rows = [
                (self.start_s + spike.time_ms / 1000, CLASSES.index(spike.afferent), spike.cell)
                for spike in spikes
            ]
            self.publisher.publish(as_message(rows))

    def between(
        self, before_s: float, before_n: float, time_s: float, force_n: float
    ) -> list[float]:
        """Samples of the grid after one message and up to the next, in N."""
        samples = []
        while True:
            number = self.stream.samples + len(samples)
            share = (self.start_s + number * self.step_s - before_s) / (time_s - before_s)
            if share > 1:
                return samples
            samples.append(before_n + share * (force_n - before_n))


def as_message(rows: list[tuple[float, int, int]]) -> Float64MultiArray:
    """Rows of spikes as a message."""
    message = Float64MultiArray()
    message.layout.dim = [
        MultiArrayDimension(label="spike", size=len(rows), stride=FIELDS * len(rows)),
        MultiArrayDimension(label="time_s,class,cell", size=FIELDS, stride=FIELDS),
    ]
    message.data = [float(number) for row in rows for number in row]
    return message


def main() -> None:
    """Run the node until Ctrl-C."""
    rclpy.init()
    node = WrenchToSpikes()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
