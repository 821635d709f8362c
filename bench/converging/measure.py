"""What is measured: fits at every sample count, and fits of one frame at rising numbers of steps."""

import json

from ..runs import checked_process

# Functions of the step figure and their arguments: network, start and loss are the same.
COMBINATIONS = {"g_c": ("--set", "combination=gc"), "f_c": ("--set", "combination=fc")}
LIMIT = 3600


def fitted(programs, rendered, spp, denoiser, preset, more, folder, environment):
    """relL2 of noisy, denoised and corrected, and the processor seconds of the fit; removes what the fit wrote."""
    files = [rendered.half(spp, name) for name in "ab"]
    z = {"--denoised-a": "a", "--denoised-b": "b", "--denoised": "full"}
    files += [word for option, name in z.items() for word in (option, rendered.denoised(spp, denoiser, name))]
    out = folder / "fit"
    command = [programs["sspc-train"], "fit", *files, "--reference", rendered.reference, "--preset", preset, *more]
    command = [str(word) for word in [*command, "--quiet", "-o", out]]
    process = checked_process("sspc-train fit", command, environment, LIMIT)
    report = json.loads((out / "report.json").read_text())
    for path in out.iterdir():
        path.unlink()
    out.rmdir()
    return {
        **{name: report["rel_l2"][name] for name in ("noisy", "denoised", "corrected")},
        "steps": report["steps"],
        "fallback": report.get("fallback"),
        "seconds": process.cpu_seconds,
    }


def by_samples(programs, rendered, counts, denoisers, preset, folder, environment, say):
    """{denoiser: {spp: figures}}."""
    out = {}
    for denoiser in denoisers:
        for spp in counts:
            found = fitted(programs, rendered, spp, denoiser, preset, (), folder, environment)
            out.setdefault(denoiser, {})[spp] = found
            say(sentence(f"{rendered.scene}, {denoiser}, {spp} spp", found))
    return out


def by_steps(programs, rendered, spp, denoiser, preset, steps, settings, folder, environment, say):
    """{combination: {steps: figures}}: each a whole training of that length, its rate schedule included."""
    out = {}
    for name, arguments in COMBINATIONS.items():
        for number in steps:
            changes = [word for change in settings for word in ("--set", change)]
            more = (*arguments, *changes, "--steps", str(number))
            found = fitted(programs, rendered, spp, denoiser, preset, more, folder, environment)
            out.setdefault(name, {})[number] = found
            say(sentence(f"{rendered.scene}, {name}, {found['steps']} steps", found))
    return out


def sentence(what, found):
    ratio = found["corrected"] / found["denoised"]
    fallback = ", fell back" if found["fallback"] else ""
    return f"{what}: {ratio:.3f} of the denoiser's, {found['seconds']:.1f} processor seconds{fallback}"
