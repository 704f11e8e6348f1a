// Flamenco job type (put it into the manager's `scripts` folder): one task for each sequence of a data set, then the
// set's own files. Workers need `python` with bpy and pecs, and the disk that recipe and set lie on.
const JOB_TYPE = {
  label: "PECS data set",
  settings: [
    { key: "recipe", type: "string", required: true, description: "RECIPE.toml, as the workers see it" },
    { key: "output", type: "string", required: true, description: "Folder of the set, as the workers see it" },
    { key: "sequences", type: "int32", default: 1, description: "How many, as the recipe says" },
    { key: "python", type: "string", default: "python", description: "A Python with bpy and pecs" },
  ],
};

function compileJob(job) {
  const words = ["-m", "pecs.datasets", job.settings.recipe, "-o", job.settings.output];
  const run = (task, args) => task.addCommand(author.Command("exec", { exe: job.settings.python, args: args }));
  const finish = author.Task("finish", "misc");
  run(finish, words);
  for (let index = 0; index < job.settings.sequences; index++) {
    const task = author.Task(`sequence ${index}`, "misc");
    run(task, words.concat(["--only", `${index}`]));
    finish.addDependency(task);
    job.addTask(task);
  }
  job.addTask(finish);
}
