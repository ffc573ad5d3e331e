# SPDX-License-Identifier: Apache-2.0
"""Run nodes as a program: executor, signals, exit codes."""

from __future__ import annotations

import argparse
import gc
import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.qos_overriding_options import InvalidQosOverridesError
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args

from plsing_ros.errors import PlsingError, StartError
from plsing_ros.geometry.yaml_file import read_yaml
from plsing_ros.nodes.overrides import check_overrides
from plsing_ros.nodes.parameterized_node import ParameterizedNode
from plsing_ros.nodes.shared_memory import clear_half_made_ports
from plsing_ros.nodes.transports import avoid_shared_memory

FAILED_AT_START = 1
BAD_INPUT = 2

# After a signal a node goes on for at most this time [s].
_SIGNAL_PERIOD = 0.1
_SPIN_TIME = 3600.0  # [s]
# A callback waits for at most about this time until another thread lends it the interpreter; Python's own is 5 ms [s].
_SWITCH_INTERVAL = 1e-4

# How rclpy reports bad ROS arguments and parameter files (RuntimeError, of which its own error types are made), bad
# parameters, names, and QoS overrides.
_REFUSED_BY_RCLPY = (RuntimeError, ParameterException, NameValidationException, InvalidQosOverridesError)


def make_executor(kind: str, context: Context) -> Executor:
    """Return an executor: "events" (EventsExecutor, several times faster) or "single" (SingleThreadedExecutor).

    Some Jazzy installations lack EventsExecutor; "events" then falls back to the other one.
    """
    if kind == "events":
        try:
            from rclpy.experimental.events_executor import EventsExecutor
        except ImportError:
            pass
        else:
            return EventsExecutor(context=context)
    return SingleThreadedExecutor(context=context)


Create = Callable[..., ParameterizedNode[Any]]


def node_parser(description: str, epilog: str) -> argparse.ArgumentParser:
    """Return the parser of a node's command line, ROS arguments left out.

    Args:
        description: What the program does, for --help.
        epilog: Examples, for --help.
    """
    parser = argparse.ArgumentParser(
        description=description, epilog=epilog, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--executor",
        choices=("events", "single"),
        default="events",
        help="events is several times faster; single is rclpy's standard one (default: %(default)s)",
    )
    return parser


def run_node(create: Create, description: str, epilog: str, argv: Sequence[str] | None = None) -> int:
    """Run one node; see run_nodes for create, argv and the exit code, node_parser for the rest."""
    return run_nodes(lambda _: [create], node_parser(description, epilog), argv)


def run_nodes(
    choose: Callable[[argparse.Namespace], Sequence[Create]],
    parser: argparse.ArgumentParser,
    argv: Sequence[str] | None = None,
) -> int:
    """Run nodes in this process, in one thread, until SIGINT or SIGTERM; return the exit code.

    Args:
        choose: Takes the options and returns what makes each node; that takes the keyword context.
        parser: Made by node_parser.
        argv: Command line without the program's name; that of the process if not given.

    Returns:
        0 after a signal; 2 with one line on standard error if a parameter, parameter file or ROS argument is bad; 1
        with one line if a node cannot start.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    context = Context()
    nodes: list[ParameterizedNode[Any]] = []
    try:
        # Before the next line, which has rcl read them already.
        _check_parameter_files(arguments)
        options = parser.parse_args(remove_ros_args(["program", *arguments])[1:])
        # From here on: a program that ends while the middleware makes a node leaves broken shared memory behind.
        received = _stop_signals()
        # Own signal handling: rclpy's would take the context away before the last, zero twist can be published.
        creates = choose(options)
        risk = avoid_shared_memory(creates, os.environ)
        rclpy.init(args=arguments, context=context, signal_handler_options=SignalHandlerOptions.NO)
        clear_half_made_ports(context.get_domain_id())
        # One by one, so that those before a refused one are known.
        for create in creates:
            nodes.append(create(context=context))
        if risk:
            nodes[0].report(risk, DiagnosticStatus.WARN)
        check_overrides(arguments, [node.get_fully_qualified_name() for node in nodes])
    except (PlsingError, *_REFUSED_BY_RCLPY) as error:
        for node in nodes:
            node.destroy_node()
        if context.ok():
            rclpy.shutdown(context=context)
        # What follows in rcl's messages is a place in its source.
        print(f"{parser.prog}: {str(error).split(', at /')[0].splitlines()[0]}", file=sys.stderr)
        return FAILED_AT_START if isinstance(error, StartError) else BAD_INPUT
    executor = make_executor(options.executor, context)
    for node in nodes:
        executor.add_node(node)
    # What is there now stays: the collector need not go through all of it again between two cycles.
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(_SWITCH_INTERVAL)
    try:
        stop: Future[None] = Future()
        # A timer sees to the signal: an idle EventsExecutor keeps Python from seeing it, and one whose nodes answer
        # each other is never idle, and then does not even come back at a timeout.
        nodes[0].create_timer(
            _SIGNAL_PERIOD,
            lambda: stop.set_result(None) if received else None,
            clock=Clock(clock_type=ClockType.STEADY_TIME),
        )
        while not received:
            if isinstance(executor, SingleThreadedExecutor):
                # Its spin_until_future_complete hangs one more function on the future for each callback it has served.
                executor.spin_once(timeout_sec=_SPIN_TIME)
            else:
                # With a timeout, because without one the EventsExecutor serves nothing.
                executor.spin_until_future_complete(stop, timeout_sec=_SPIN_TIME)
    finally:
        # After a signal, and just as well when a callback has failed.
        with ExitStack() as ending:
            ending.callback(rclpy.shutdown, context=context)
            ending.callback(executor.shutdown)
            for node in nodes:
                ending.callback(node.destroy_node)
                ending.callback(executor.remove_node, node)
            for node in nodes:
                ending.callback(node.stop)
    return 0


def _check_parameter_files(arguments: Sequence[str]) -> None:
    """Refuse files that would keep rcl's reader busy or end it; what it cannot open it says itself."""
    for option, file in pairwise(arguments):
        if option == "--params-file" and Path(file).is_file():
            read_yaml(file, "parameter file")


def _stop_signals() -> list[int]:
    """Return a list that SIGINT and SIGTERM are appended to when they come."""
    received: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda which, _: received.append(which))
    return received
