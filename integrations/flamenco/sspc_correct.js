// Renders the halves of a shot with Cycles, fits one model to a few frames and corrects all of them.
// A job type of Flamenco 3: lies in the folder `scripts` beside flamenco-manager.

const JOB_TYPE = {
    label: "Cycles render, corrected by sspc",
    description: "Render two halves of the samples, fit a corrector to the shot and correct every frame",
    settings: [
        { key: "frames", type: "string", required: true,
          eval: "f'{C.scene.frame_start}-{C.scene.frame_end}'",
          evalInfo: { showLinkButton: true, description: "Scene frame range" },
          description: "Frames to render and correct. Examples: '47', '1-30', '3, 5-10, 47-327'" },
        { key: "fit_frames", type: "string", required: true,
          eval: "f'{C.scene.frame_start},{C.scene.frame_end}'",
          evalInfo: { showLinkButton: true, description: "First and last frame" },
          description: "The few frames to fit the model on, among those to render" },
        { key: "chunk_size", type: "int32", default: 5, propargs: { min: 1 }, visible: "submission",
          description: "Frames that one task renders or corrects; changes nothing in the pictures" },
        { key: "preset", type: "string", required: true, default: "balanced",
          choices: ["fast", "balanced", "quality", "paper"], visible: "submission", description: "How long to train" },
        { key: "render_output_root", type: "string", subtype: "dir_path", required: true, visible: "submission",
          description: "Folder for the folders of jobs" },
        { key: "render_output_path", type: "string", subtype: "dir_path", editable: false,
          eval: "str(Path(abspath(settings.render_output_root), jobname, '{timestamp}'))",
          description: "Folder of this job's halves, model and pictures" },
        { key: "sspc_train", type: "string", required: true, default: "sspc-train", visible: "submission",
          description: "The program sspc-train, by name or path" },
        { key: "sspc_infer", type: "string", required: true, default: "sspc-infer", visible: "submission",
          description: "The program sspc-infer, by name or path" },
        { key: "blendfile", type: "string", required: true, visible: "web", description: "The file to render" },
        { key: "engine", type: "string", required: true, eval: "C.scene.render.engine", visible: "hidden" },
    ],
};

// Seeds of the halves: any two that differ.
const HALVES = [{ name: "a", seed: 1 }, { name: "b", seed: 2 }];
// Blender's and sspc's sign for a frame number of six digits.
const NUMBER = "######";

function compileJob(job) {
    const settings = job.settings;
    if (settings.engine !== "CYCLES") {
        throw `sspc needs halves of Cycles, and the scene renders with ${settings.engine}`;
    }
    settings.render_output_path = settings.render_output_path.replace("{timestamp}", formatTimestampLocal(job.created));
    const chunks = frameChunker(settings.frames, settings.chunk_size);
    const renders = new Map(chunks.map((chunk) => [chunk, HALVES.map((half) => renderTask(settings, half, chunk))]));

    const fit = fitTask(settings);
    for (const frame of framesOf(settings.fit_frames)) {
        const chunk = chunks.find((chunk) => framesOf(chunk).includes(frame));
        if (chunk === undefined) {
            throw `frame ${frame} of fit_frames is not among the frames to render, ${settings.frames}`;
        }
        dependOn(fit, renders.get(chunk));
    }
    for (const tasks of renders.values()) {
        tasks.forEach((task) => job.addTask(task));
    }
    job.addTask(fit);
    for (const chunk of chunks) {
        const correct = correctTask(settings, chunk);
        dependOn(correct, [fit].concat(renders.get(chunk)));
        job.addTask(correct);
    }
}

function dependOn(task, others) {
    others.forEach((other) => task.addDependency(other));
}

// Half of the samples with a seed of its own, denoised by Cycles, with what both programs read.
function renderTask(settings, half, chunk) {
    const task = author.Task(`render-${half.name}-${chunk}`, "blender");
    task.addCommand(author.Command("blender-render", {
        exe: "{blender}",
        exeArgs: "{blenderArgs}",
        argsBefore: [],
        blendfile: settings.blendfile,
        args: [
            "--python-expr", halfSettings(half.seed),
            "--render-output", patternOf(settings, half.name),
            "--render-frame", chunk.replaceAll("-", ".."),
        ],
    }, framesOf(chunk).length));
    return task;
}

function halfSettings(seed) {
    return [
        "import bpy",
        "scene = bpy.context.scene",
        "cycles, render = scene.cycles, scene.render",
        `cycles.seed, cycles.samples = ${seed}, max(1, cycles.samples // 2)`,
        "cycles.use_denoising, cycles.denoiser = True, 'OPENIMAGEDENOISE'",
        "[setattr(layer.cycles, 'denoising_store_passes', True) for layer in scene.view_layers]",
        "render.use_compositing = render.use_sequencer = False",
        "render.use_file_extension, render.use_overwrite, render.use_placeholder = True, True, False",
        "image = render.image_settings",
        // Blender 5 asks for the kind of file first.
        "hasattr(image, 'media_type') and setattr(image, 'media_type', 'MULTI_LAYER_IMAGE')",
        "image.file_format, image.color_depth = 'OPEN_EXR_MULTILAYER', '32'",
    ].join("; ");
}

function fitTask(settings) {
    const task = author.Task("fit", "misc");
    task.addCommand(author.Command("exec", {
        exe: settings.sspc_train,
        args: ["fit", ...halves(settings), "--frames", compact(settings.fit_frames), "--preset", settings.preset,
               "-o", path.join(settings.render_output_path, "fit")],
    }));
    return task;
}

function correctTask(settings, chunk) {
    const task = author.Task(`correct-${chunk}`, "misc");
    task.addCommand(author.Command("exec", {
        exe: settings.sspc_infer,
        args: ["run", "--model", path.join(settings.render_output_path, "fit", "model.onnx"), ...halves(settings),
               "--frames", compact(chunk), "-o", `${patternOf(settings, "corrected")}.exr`],
    }));
    return task;
}

function halves(settings) {
    return HALVES.flatMap((half) => [`--${half.name}`, `${patternOf(settings, half.name)}.exr`]);
}

// Of the files of a half or of the pictures, without their ending.
function patternOf(settings, name) {
    return path.join(settings.render_output_path, `${name}.${NUMBER}`);
}

// "3, 5-7" as sspc takes it.
function compact(frames) {
    return `${frames}`.replaceAll(" ", "");
}

// "3, 5-7" as [3, 5, 6, 7].
function framesOf(frames) {
    return compact(frames).split(",").flatMap((range) => {
        const [first, last = first] = range.split("-").map(Number);
        return Array.from({ length: last - first + 1 }, (_, at) => first + at);
    });
}
