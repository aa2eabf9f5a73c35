/* `cargo xtask monitor` for the scripts that look at its page, with a job that takes as long as they look. */

'use strict';

const { spawn } = require('child_process');
const net = require('net');
const path = require('path');
const readline = require('readline');

const { check, until } = require('./cncjs');

// Realtime bytes: go on, and feed hold; feed at 10 % and at 200 %.
const GO_ON = '~';
const HOLD = '!';
const SLOWLY = `\x90${'\x92'.repeat(9)}`;
const FAST = `\x90${'\x91'.repeat(10)}`;

/**
 * Starts the monitor or the simulator, and waits until it tells an address; with `url`, as it is printed, the process
 * itself, and what waits for its end.
 */
async function start(program, options) {
  // A program has the name of its command.
  const child = spawn(program, [path.basename(program), ...options], { stdio: ['ignore', 'ignore', 'pipe'] });
  const kill = () => child.kill();
  process.on('exit', kill);
  child.on('exit', () => process.off('exit', kill));
  const said = [];
  readline.createInterface({ input: child.stderr }).on('line', (line) => said.push(line));
  let [url, address] = [];
  await until(() => {
    check(child.exitCode === null, `${program} has ended: ${said.join('\n')}`);
    [url, address] = said.join('\n').match(/\w+:\/\/([\d.:]+)\S*/) || [];
    return address;
  }, `${program} tells an address`);
  const succeeds = async () => {
    await until(() => child.exitCode !== null, `${program} ends`);
    check(child.exitCode === 0, `${program} has failed: ${said.join('\n')}`);
  };
  return { address, url, child, succeeds };
}

/** Starts the monitor with a job for the simulator, to which `press` sends realtime bytes, and `first` before all. */
async function startJob([monitor, simulator, job, settings], first = '') {
  // The stream of positions is on.
  const options = ['--settings', settings, '--set', '$792=1', '--set', '$793=1'];
  const { address } = await start(simulator, ['--tcp', '127.0.0.1:0', ...options]);
  const machine = net.connect(address.split(':')[1], '127.0.0.1');
  const server = net.createServer((socket) => {
    // A monitor whose job ends in an alarm leaves bytes unread.
    socket.on('error', () => {});
    socket.pipe(machine).pipe(socket);
  });
  await new Promise((listens) => { server.listen(0, '127.0.0.1', listens); });
  const press = (bytes) => machine.write(bytes, 'latin1');
  press(first);
  return { press, ...await start(monitor, [job, '--tcp', `127.0.0.1:${server.address().port}`]) };
}

module.exports = {
  FAST, GO_ON, HOLD, SLOWLY, start, startJob,
};
