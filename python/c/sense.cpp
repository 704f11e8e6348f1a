// The whole sensor, from file to file.
#include "pecs/sensor/sense.h"

#include "guard.h"
#include "handles.h"
#include "pecs/files.h"
#include "pecs/run_record.h"
#include "pecs/sensor/sense_options.h"

using pecs::capi::given;
using namespace pecs::sensor;

extern "C" char* pecs_sense(const char* input, const char* output, const char* options_json, const pecs_model* model,
                            pecs_progress_fn progress, void* user, pecs_error* error) {
  return pecs::capi::guard(error, [&] {
    const pecs::Json json = pecs::capi::options_from(options_json);
    SenseOptions options = sense_options(pecs::JsonObject(json, "options"));
    pecs::capi::use_model(model, options.model);
    options.stack = &given(input, "input");
    options.output = &given(output, "output");
    pecs::check_outputs({options.stack, options.times.file_us.value_or(""), options.bias_file.value_or(""),
                         options.stages.mask.value_or("")},
                        outputs_of(options));
    options.quiet = true;
    if (progress) options.progress = [=](double done) { return progress(done, user) != 0; };
    const SenseReport report = sense(options);
    pecs::write_run_record(options.output,
                           {"sense", report.config, {options.stack}, report.results, {pecs::text_of(json)}});
    const pecs::Json out = {
        {"config", report.config}, {"results", report.results}, {"warnings", report.results.at("warnings")}};
    return pecs::capi::hand_over(out);
  });
}
