'use strict';
const socket = new WebSocket(`ws://${location.host}/socket`);
const show = (id, text) => { document.getElementById(id).textContent = text; };
const ask = (command) => socket.send(JSON.stringify(command));
const shown = {
  control: (event) => show('control', `${event.machine}: ${event.is_mine ? 'this page controls' : 'this page watches'}`),
  state: (event) => show('state', JSON.stringify(event, null, 1)),
  note: (event) => show('notes', event.text),
};
socket.onmessage = ({ data }) => JSON.parse(data).forEach((event) => shown[event.is]?.(event));
socket.onclose = () => show('control', 'the server has gone: load the page again');
document.getElementById('hold').onclick = () => ask({ do: 'realtime', byte: 33 });
document.getElementById('take').onclick = () => ask({ do: 'take-control' });
