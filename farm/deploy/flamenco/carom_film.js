// SPDX-License-Identifier: MIT OR Apache-2.0
// A film for Flamenco 3: copy this file to the Manager's `scripts` folder. The workers need the program
// `carom`, and the shared storage with the recorded shot.
const JOB_TYPE = {
    label: "Carom film",
    description: "Trace a recorded shot in chunks of frames, then put the film together",
    settings: [
        { key: "replay", type: "string", subtype: "file_path", required: true,
          description: "The recorded shot (.carom)" },
        { key: "video", type: "string", required: true,
          description: "The film, .y4m or .png; its frames lie in a folder beside it" },
        { key: "frames", type: "string", required: true, default: "0-239",
          description: "The frames of the film, as in 0-239" },
        { key: "chunk_size", type: "int32", default: 10, description: "Frames of a task" },
        { key: "size", type: "string", default: "1280x720" },
        { key: "spp", type: "int32", default: 64, description: "Samples per pixel" },
        { key: "exe", type: "string", default: "carom", visible: "web" },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    const film = ["--replay", settings.replay, "--video", settings.video,
        "--size", settings.size, "--spp", String(settings.spp)];
    const assemble = author.Task("film", "misc");
    assemble.addCommand(author.Command("exec", { exe: settings.exe, args: film }));
    for (const chunk of frameChunker(settings.frames, settings.chunk_size)) {
        const task = author.Task(`frames-${chunk}`, "misc");
        const args = film.concat(["--frame-range", chunk]);
        task.addCommand(author.Command("exec", { exe: settings.exe, args: args }));
        job.addTask(task);
        assemble.addDependency(task);
    }
    job.addTask(assemble);
}
