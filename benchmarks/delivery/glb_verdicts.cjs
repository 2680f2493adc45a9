// What Khronos' validator says of GLB files: node glb_verdicts.cjs MODULES FILE...
const fs = require('fs');
const [modules, ...files] = process.argv.slice(2);
const validator = require(modules + '/gltf-validator');
Promise.all(files.map((file) => validator.validateBytes(new Uint8Array(fs.readFileSync(file))))).then((reports) =>
  console.log(JSON.stringify(reports.map((report) => ({
    version: report.validatorVersion, errors: report.issues.numErrors, warnings: report.issues.numWarnings,
    said: report.issues.messages.filter((one) => one.severity < 2).map((one) => one.message),
  })))));
