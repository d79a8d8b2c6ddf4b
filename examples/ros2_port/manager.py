"""Leads the driver through its lifecycle, and looks at what it measures."""

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import Int32


class Manager(Node):
    def __init__(self):
        super().__init__("manager")
        self.change = self.create_client(ChangeState, "/driver/change_state")
        self.state = self.create_client(GetState, "/driver/get_state")
        self.subscription = self.create_subscription(Int32, "measured", self.note, 10)
        self.seen = []
        self.change.wait_for_service()

    def note(self, message):
        self.seen.append(message.data)

    def call(self, client, request):
        future = client.call_async(request)
        rclpy.spin_until_future_complete(self, future)
        return future.result()

    def go(self, transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        changed = self.call(self.change, request).success
        label = self.call(self.state, GetState.Request()).current_state.label
        print("changed" if changed else "refused", "to" if changed else "in", label, flush=True)

    def wait(self, seconds):
        until = self.get_clock().now() + Duration(seconds=seconds)
        while self.get_clock().now() < until:
            rclpy.spin_once(self, timeout_sec=0.05)


def main(args=None):
    rclpy.init(args=args)
    node = Manager()
    node.go(Transition.TRANSITION_ACTIVATE)
    node.go(Transition.TRANSITION_CONFIGURE)
    node.wait(0.35)
    node.go(Transition.TRANSITION_ACTIVATE)
    node.wait(0.35)
    node.go(Transition.TRANSITION_DEACTIVATE)
    node.go(Transition.TRANSITION_CLEANUP)
    print("seen:", node.seen, flush=True)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
