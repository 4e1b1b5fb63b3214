// The report of Khronos' validator on a glTF file, as JSON: node validate_gltf.js PACKAGES FILE
const [packages, file] = process.argv.slice(2);
const validator = require(require("path").join(packages, "node_modules", "gltf-validator"));
validator
  .validateBytes(new Uint8Array(require("fs").readFileSync(file)))
  .then((report) => process.stdout.write(JSON.stringify(report)));
