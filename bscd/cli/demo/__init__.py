"""`bscd demo`: the whole measurement on the built-in digital twin, in virtual time, held against its truth."""

from bscd.cli.demo.command import DEFAULT_CONFIG, DemoResult, register, run_demo

__all__ = ["DEFAULT_CONFIG", "DemoResult", "register", "run_demo"]
