"""The command line of bench/convergence: renders what is missing, measures, writes figures, table and JSON."""

import json
import os
import signal
import sys
import tempfile
from pathlib import Path

from .. import common, machine
from ..record import free_stem, name_of
from ..runs import Failed
from . import measure, record

PROG = "bench/convergence"
DESCRIPTION = f"""\
The paper's figures, measured: renders a scene of scenes/ at rising sample counts, denoises it with OIDN (with features
and without), corrects every frame and writes a dated record (Markdown, JSON, figures as SVG and PNG):
 1. relL2 against samples per pixel, noisy, and each denoiser with and without correction;
 2. relL2 against training steps for g_c and f_c with the paper's network, start and loss (--steps-preset, --set);
 3. equal time: render + denoise against fewer samples + denoise + correct, in processor seconds.
Needs matplotlib, and what scenes/ needs (scenes/README.md), in the interpreter that runs it; programs first:
`{common.BUILD}`.
Exit codes: 0 done, 1 a run failed, 2 bad arguments or a missing package, 130 interrupted (rendered files are kept)."""

NEEDED = ("numpy", "mitsuba", "pyoidn", "OpenEXR", "matplotlib")


def main(arguments=None):
    parser = command_line()
    options = parser.parse_args(arguments)
    check(options)
    from scenes.worker import Failed as RendererFailed

    from . import frames

    train = common.program(options, "sspc-train")
    about = common.about(PROG, arguments, options, [train])
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    environment = common.environment(options)
    results = {}
    try:
        for scene in options.scene:
            rendered = frames.Rendered(options.frames / f"{scene}-{options.size[0]}x{options.size[1]}", scene)
            spp = sorted({*options.spp, options.steps_spp})
            frames.render(rendered, spp, options.size, options.reference_spp, options.threads, say)
            results[scene] = of_scene(rendered, {"sspc-train": train}, options, environment)
    except KeyboardInterrupt:
        say("interrupted: rendered files are kept")
        return 130
    except (Failed, RendererFailed) as why:
        print(f"bench: {why}", file=sys.stderr)
        return 1
    about["load_average_after"] = machine.load()
    for path in write(options, about, results):
        say(f"wrote {path}")
    return 0


def of_scene(rendered, programs, options, environment):
    """Everything that is measured of one scene."""
    with tempfile.TemporaryDirectory(prefix="sspc-convergence-") as scratch:
        place = (Path(scratch), environment, say)
        samples = measure.by_samples(programs, rendered, options.spp, options.denoisers, options.preset, *place)
        one = (options.steps_spp, options.denoisers[0], options.steps_preset, options.steps, options.set)
        steps = measure.by_steps(programs, rendered, *one, *place)
    return {"samples": samples, "steps": steps, "seconds": rendered.seconds()}


def write(options, about, results):
    """Writes the record and returns its files."""
    from . import plots

    options.output.mkdir(parents=True, exist_ok=True)
    stem, written = free_stem(options.output, f"convergence-{name_of(about)}"), []
    width, height = options.size
    for scene, found in results.items():
        what = f"{scene}, {width} x {height}"
        title = f"{what}: {options.preset}"
        path = options.output / f"{stem}-{scene}-samples"
        plots.by_samples(found["samples"], title, path)
        changed = f", {' '.join(options.set)}" if options.set else ""
        title = f"{what}, {options.steps_spp} spp: preset {options.steps_preset}{changed}"
        steps = options.output / f"{stem}-{scene}-steps"
        plots.by_steps(found["steps"], title, steps)
        written += [p.with_suffix(kind) for p in (path, steps) for kind in (".svg", ".png")]
    texts = {
        ".md": record.markdown(options, about, results, stem),
        ".json": json.dumps({"about": about, "results": results}, indent=1),
    }
    for ending, text in texts.items():
        written.append(options.output / (stem + ending))
        written[-1].write_text(text + "\n")
    return written


def command_line():
    parser = common.parser(PROG, DESCRIPTION)
    common.add_output(parser)
    option = parser.add_argument
    option(
        "--frames", type=Path, required=True, metavar="DIR", help="folder for the rendered frames; kept and used again"
    )
    option(
        "--scene",
        action="append",
        metavar="NAME",
        help="scene of scenes/, by Mitsuba; repeatable (default glass-table)",
    )
    option("--size", type=common.sizes, default="320x180", metavar="WxH", help="pixels (default 320x180)")
    option("--spp", type=common.numbers, default="8,16,32,64,128", metavar="8,16", help="samples per pixel, even")
    option(
        "--reference-spp",
        type=common.positive,
        default=1024,
        metavar="N",
        help="samples of the reference (default 1024)",
    )
    option(
        "--denoisers", type=words, default="oidn,oidn-colour", metavar="A,B", help="oidn, oidn-colour (default both)"
    )
    option("--preset", default="balanced", help="preset of every fit (default balanced)")
    option("--steps", type=common.numbers, default="10,30,100,300", metavar="30,100", help="steps of the step figure")
    option("--steps-preset", default="paper", metavar="PRESET", help="preset of the step figure (default paper)")
    option("--steps-spp", type=common.positive, default=32, metavar="N", help="samples of the step figure (default 32)")
    option(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="a setting of both functions in the step figure, as sspc-train fit takes it; repeatable",
    )
    return parser


def check(options, needed=NEEDED):
    """Ends the command where an argument makes no sense or a package is missing."""
    import importlib.util

    from scenes.catalogue import SCENES

    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        common.fail(f"{', '.join(missing)} cannot be imported; install scenes/requirements.txt and matplotlib")
    options.scene = options.scene or ["glass-table"]
    for scene in options.scene:
        if scene not in SCENES or SCENES[scene].renderer != "mitsuba":
            known = ", ".join(name for name, s in SCENES.items() if s.renderer == "mitsuba")
            common.fail(f"--scene {scene}: expected one of {known}")
    if len(options.size) != 1:
        common.fail("--size: expected one size")
    options.size = options.size[0]
    odd = [spp for spp in (*options.spp, options.steps_spp, options.reference_spp) if spp < 2 or spp % 2]
    if odd:
        common.fail(f"{odd[0]} samples cannot be halved: expected even numbers")
    unknown = set(options.denoisers) - {"oidn", "oidn-colour"}
    if unknown or not options.denoisers:
        common.fail(f"--denoisers: expected oidn, oidn-colour or both, found {', '.join(sorted(unknown)) or 'none'}")
    if not hasattr(os, "sched_getaffinity"):
        common.fail("processor seconds of the renderer are read from /proc, which this system lacks")


def words(value):
    return [word for word in value.split(",") if word]


def say(text):
    print(text, flush=True)
