/* The page begins: with what is packed into it. */

const read = (bytes) => new TextDecoder().decode(bytes);
const [factBytes, pathBytes, curveBytes, programBytes] = await Promise.all(['facts', 'path', 'curves', 'program'].map(unpack));
const facts = JSON.parse(read(factBytes));
window.view = new View(facts, decodePath(pathBytes, facts), decodeCurves(curveBytes, facts), read(programBytes));
if (frame) frame.begin(window.view);
document.body.dataset.ready = 'yes';
