// The Khronos validator on one file: exit 1 if it finds an error or a warning.
const fs = require("fs");
const validator = require("gltf-validator");

const path = process.argv[2];
validator.validateBytes(new Uint8Array(fs.readFileSync(path))).then((report) => {
  const { numErrors, numWarnings, messages } = report.issues;
  for (const m of messages.filter((m) => m.severity <= 1)) console.log(`${m.code} ${m.pointer}: ${m.message}`);
  console.log(`validator: ${numErrors} errors, ${numWarnings} warnings`);
  process.exit(numErrors + numWarnings > 0 ? 1 : 0);
});
