"""The one compiled part: the correlator's kernel (docs/decisions/0003). All else is in pyproject.toml."""

from setuptools import Extension, setup

setup(
    ext_modules=[
        Extension(
            "bscd.dic._icgn",
            sources=["bscd/dic/kernel/icgn.c"],
            depends=[
                f"bscd/dic/kernel/{name}.h"
                for name in (
                    "current",
                    "icgn",
                    "interpolation",
                    "lanes",
                    "linear",
                    "pixels",
                    "reference",
                    "solve",
                    "vectors",
                    "warp",
                )
            ],
            extra_compile_args=[
                "-std=gnu11",
                "-O3",
                "-ffp-contract=fast",
                "-fno-math-errno",
                "-fno-trapping-math",
                "-Wall",
                "-Wno-psabi",
            ],
            libraries=["m"],
        )
    ]
)
