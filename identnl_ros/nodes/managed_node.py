# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What all nodes have in common: lifecycle, parameters, diagnostics, an orderly end."""

from collections.abc import Callable, Iterator
from functools import wraps
import traceback
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray
from identnl_ros.core.errors import DataError, IdentnlError
from identnl_ros.nodes import qos
from identnl_ros.nodes.diagnosis import Health, Level, to_array
from identnl_ros.nodes.parameters import AUTOSTART, declare, unknown_overrides
from identnl_ros.sources.setting import Setting
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.subscription import Subscription

DIAGNOSTICS_INTERVAL = 1.0  # [s]


class ManagedNode(LifecycleNode):
    """
    A node that is configured, activated, watched and ended in the same way as all others.

    A node overrides `configure`, `activate`, `deactivate`, `clean_up`, `diagnose`, `tick` and,
    where there is something to finish, `begin_to_end`, `is_drained` and `finish`.

    Parameters
    ----------
    name : str
    **options
        As for a node of rclpy.

    """

    settings: ClassVar[tuple[Setting, ...]] = ()

    def __init__(self, name: str, **options: Any) -> None:
        self.is_configured = False
        self.is_active = False
        self.wants_to_exit = False
        self.failure = ''
        self.stand = ''
        self._errors_caught = 0
        self._endings: list[Callable[[], object]] = []
        super().__init__(name, **options)
        declare(self, (AUTOSTART, *self.all_settings()), lambda: self.is_configured)
        # Those for another node of the process may come to this one too.
        known = {one.name for kind in _kinds(ManagedNode) for one in kind.all_settings()}
        known |= set(self.list_parameters([], 0).names)
        for sentence in unknown_overrides(self._parameter_overrides, known):
            self.get_logger().warning(sentence)
        self._diagnostics = self.create_publisher(
            DiagnosticArray, '/diagnostics', qos.diagnostics()
        )
        self.create_timer(DIAGNOSTICS_INTERVAL, self.guarded(self.publish_diagnostics))

    @classmethod
    def all_settings(cls) -> tuple[Setting, ...]:
        """
        Give the parameters of such a node.

        Returns
        -------
        tuple of Setting
            `settings`, and those that depend on what is installed.

        """
        return cls.settings

    def configure(self) -> None:
        """Read parameters, create what the node needs; errors are told to the user."""

    def activate(self) -> None:
        """Begin to work."""

    def deactivate(self) -> None:
        """Pause."""

    def clean_up(self) -> None:
        """Drop all that was made by `configure`; may be called after half of it."""

    def diagnose(self) -> list[Health]:
        """Tell how it goes; called every second in any state."""
        return []

    def begin_to_end(self) -> None:
        """Process is to end: take nothing new."""

    def is_drained(self) -> bool:
        """Tell whether all that has arrived is used."""
        return True

    def finish(self) -> None:
        """Publish or write what is left, after draining."""

    def setting(self, name: str) -> Any:
        """
        Value of a parameter.

        Parameters
        ----------
        name : str

        Returns
        -------
        bool, int, float, str or list of str

        Raises
        ------
        DataError
            If it cannot be used.

        """
        value = self.get_parameter(name).value
        for setting in self.all_settings():
            if setting.name == name and (reason := setting.refusal(value)):
                raise DataError(reason)
        return value

    def start(self) -> bool:
        """
        Configure and activate if the node is to do so itself.

        Returns
        -------
        bool
            Whether that worked.

        """
        if not self.get_parameter(AUTOSTART.name).value:
            return True
        success = TransitionCallbackReturn.SUCCESS
        return bool(self.trigger_configure() == success and self.trigger_activate() == success)

    def guarded(self, callback: Callable[..., object]) -> Callable[..., None]:
        """
        Wrap a callback so that no error in it ends the node.

        Parameters
        ----------
        callback : callable

        Returns
        -------
        callable

        """

        @wraps(callback)  # with its signature, from which rclpy sees what to pass
        def run(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except IdentnlError as error:
                self._errors_caught += 1
                self.tell_failure(str(error))
            except Exception:
                self._errors_caught += 1
                self.tell_failure(f'unexpected error, please report:\n{traceback.format_exc()}')

        return run

    def tell_failure(self, sentence: str) -> None:
        """
        Log an error once and show it in the diagnostics.

        Parameters
        ----------
        sentence : str

        """
        if sentence != self.failure:
            self.get_logger().error(sentence)
        self.failure = sentence

    def subscribe(
        self, message_type: type, topic: str, callback: Callable[..., None], **options: Any
    ) -> Subscription:
        """
        Subscribe until the node is cleaned up.

        Parameters
        ----------
        message_type : type
        topic : str
        callback : callable
            Errors in it are told and survived.
        **options
            As for `create_subscription`, `qos_profile` among them.

        Returns
        -------
        Subscription

        """
        subscription = self.create_subscription(
            message_type,
            topic,
            self.guarded(callback),
            options.pop('qos_profile'),
            qos_overriding_options=qos.overriding(),
            **options,
        )
        self._endings.append(lambda: self.destroy_subscription(subscription))
        return subscription

    def publish_on(self, message_type: type, topic: str, qos_profile: Any) -> Any:
        """
        Make a publisher that works while the node is active, until it is cleaned up.

        Parameters
        ----------
        message_type : type
        topic : str
        qos_profile : QoSProfile

        Returns
        -------
        LifecyclePublisher

        """
        publisher = self.create_lifecycle_publisher(
            message_type, topic, qos_profile, qos_overriding_options=qos.overriding()
        )
        self._endings.append(lambda: self.destroy_lifecycle_publisher(publisher))
        return publisher

    def every(self, interval: float, callback: Callable[[], None]) -> None:
        """
        Call again and again until the node is cleaned up.

        Parameters
        ----------
        interval : float
            [s].
        callback : callable

        """
        timer = self.create_timer(interval, self.guarded(callback))
        self._endings.append(lambda: self.destroy_timer(timer))

    def publish_diagnostics(self) -> None:
        """Publish the health of the node and its parts."""
        state = self._state_machine.current_state[1]
        own = Health('node', {'lifecycle state': state, 'errors': self._errors_caught})
        if self.failure:
            own.add(Level.ERROR, self.failure.splitlines()[0])
        parts = [own, *(self.diagnose() if self.is_configured else [])]
        self._diagnostics.publish(
            to_array(parts, self.get_fully_qualified_name(), self.stand, self.get_clock().now())
        )

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.failure = ''
        if not self._attempt(self.configure):
            self._release()
            return TransitionCallbackReturn.FAILURE
        self.is_configured = True
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        super().on_activate(state)
        if not self._attempt(self.activate):
            super().on_deactivate(state)
            return TransitionCallbackReturn.FAILURE
        self.is_active = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._pause()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._release()
        self.failure = ''
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def close(self) -> None:
        """Finish what is begun and let go of everything, in any state."""
        if self.is_configured:
            self._attempt(self.finish)
        self._pause()
        self._release()

    def _pause(self) -> None:
        if self.is_active:
            self.is_active = False
            self._attempt(self.deactivate)

    def _release(self) -> None:
        self._attempt(self.clean_up)
        self.is_configured = False
        while self._endings:
            self._attempt(self._endings.pop())

    def _attempt(self, step: Callable[[], object]) -> bool:
        failed = self._errors_caught
        self.guarded(step)()
        return self._errors_caught == failed

    # rclpy lets the error of a transition that is not possible end the whole process.
    def _LifecycleNodeMixin__on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        try:
            answer = super()._LifecycleNodeMixin__on_change_state  # type: ignore[misc]
            return answer(request, response)
        except Exception as error:
            wanted = request.transition.label or request.transition.id
            state = self._state_machine.current_state[1]
            self.get_logger().warning(
                f'transition {wanted} is not possible in state {state}: {error}'.splitlines()[0]
            )
            response.success = False
            return response


def _kinds(kind: type[ManagedNode]) -> Iterator[type[ManagedNode]]:
    """Yield a class of nodes and all derived from it."""
    yield kind
    for derived in kind.__subclasses__():
        yield from _kinds(derived)
