// Compiles a job as Flamenco's manager does, with a stand-in of what it gives to scripts; prints the tasks as JSON.
//
//     node stand_in.js sspc_correct.js '{"frames": "1-3", ...}'

"use strict";
const fs = require("fs");
const path = require("path");
const vm = require("vm");

class Task {
    constructor(name, type) {
        if (!name || !type) throw new Error("author.Task(name, type): both are required");
        Object.assign(this, { name, type, commands: [], dependencies: [] });
    }

    addCommand(command) {
        this.commands.push(command);
    }

    addDependency(task) {
        if (!(task instanceof Task)) throw new Error("addDependency(task): expected a task");
        this.dependencies.push(task.name);
    }
}

const author = {
    Task: (name, type) => new Task(name, type),
    Command: (name, parameters, steps = 0) => ({ name, parameters, steps }),
};

// "3, 5-10" in chunks of at most `size` frames, each as the manager writes it: "3,5-6".
function frameChunker(range, size) {
    const frames = range.split(",").flatMap((part) => {
        const [first, last = first] = part.split("-").map(Number);
        return Array.from({ length: last - first + 1 }, (_, at) => first + at);
    });
    const chunks = [];
    for (let at = 0; at < frames.length; at += size) chunks.push(merged(frames.slice(at, at + size)));
    return chunks;
}

function merged(frames) {
    const runs = [];
    for (const frame of frames) {
        const run = runs[runs.length - 1];
        if (run && run[1] === frame - 1) run[1] = frame;
        else runs.push([frame, frame]);
    }
    return runs.map(([first, last]) => (first === last ? `${first}` : `${first}-${last}`)).join(",");
}

function compiled(script, given) {
    const formatTimestampLocal = () => "2026-01-02_030405";
    const context = vm.createContext({ author, path: path.posix, frameChunker, formatTimestampLocal, print: () => {} });
    vm.runInContext(fs.readFileSync(script, "utf8"), context, { filename: script });
    const { JOB_TYPE, compileJob } = vm.runInContext("({ JOB_TYPE, compileJob })", context);
    // The add-on evaluates `eval` in Blender; here it has to be given.
    const settings = Object.fromEntries(JOB_TYPE.settings.map(({ key, default: value }) => [key, value]));
    Object.assign(settings, given);
    const missing = JOB_TYPE.settings.filter(({ key, required }) => required && settings[key] === undefined);
    if (missing.length > 0) throw new Error(`no value for ${missing.map(({ key }) => key)}`);
    const tasks = [];
    compileJob({ name: "job", created: new Date(0), settings, addTask: (task) => tasks.push(task) });
    return { type: JOB_TYPE, settings, tasks };
}

try {
    const [script, settings] = process.argv.slice(2);
    process.stdout.write(JSON.stringify(compiled(script, JSON.parse(settings))));
} catch (error) {
    process.stderr.write(`${error.message || error}\n`);
    process.exitCode = 1;
}
