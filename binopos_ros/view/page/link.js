// The connection to the server: opened again whenever it is lost, and known to be lost within a second.

export const STALE_MS = 1000;
const PAUSES_MS = [300, 700, 1500, 3000];
const PICTURE_HEADER = 16;
const KINDS = ['left', 'right', 'board'];

export class Link {
  // take(text object), show({side, stamp, jpeg}), tell(word, isCut)
  constructor(take, show, tell) {
    Object.assign(this, {take, show, tell});
    this.token = new URLSearchParams(location.search).get('token') ?? '';
    this.failures = 0;
    this.heard = 0;
    this.watches = true;
    this.drawn = false;
    setInterval(() => this.look(), 200);
    this.open();
  }

  open() {
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    const query = this.token ? `?token=${encodeURIComponent(this.token)}` : '';
    this.socket = new WebSocket(`${scheme}://${location.host}/ws${query}`);
    this.socket.binaryType = 'arraybuffer';
    this.socket.onopen = () => { this.failures = 0; this.watch(this.watches); };
    this.socket.onmessage = (event) => this.hear(event.data);
    this.socket.onclose = (event) => this.lost(event);
  }

  hear(data) {
    this.heard = performance.now();
    if (typeof data === 'string') {
      this.take(JSON.parse(data));
      return;
    }
    const head = new DataView(data, 0, PICTURE_HEADER);
    const side = KINDS[head.getUint8(4)];
    const stamp = head.getBigUint64(8).toString();
    const drawn = head.getUint8(5) === 1;
    this.show({side, stamp, drawn, jpeg: new Blob([new Uint8Array(data, PICTURE_HEADER)], {type: 'image/jpeg'})});
  }

  async lost(event) {
    const pause = PAUSES_MS[Math.min(this.failures++, PAUSES_MS.length - 1)];
    let why = event.reason || 'connection lost';
    if (this.failures > 1) {
      try {
        const query = this.token ? `?token=${encodeURIComponent(this.token)}` : '';
        const answer = await fetch(`/metrics${query}`);
        if (answer.status === 403) why = 'wrong token: open the whole address that binopos view has printed';
      } catch { why = 'no server: does binopos view still run?'; }
    }
    this.tell(`${why}; trying again`, true);
    setTimeout(() => this.open(), pause);
  }

  look() {
    const silent = performance.now() - this.heard;
    if (this.socket.readyState !== WebSocket.OPEN) return;
    if (silent > STALE_MS) this.tell(`nothing heard for ${(silent / 1000).toFixed(0)} s`, true);
    else this.tell('connected', false);
  }

  get isCut() { return performance.now() - this.heard > STALE_MS; }

  watch(pictures, drawn = this.drawn) {
    this.watches = pictures;
    this.drawn = drawn;
    this.send({type: 'watch', pictures, drawn});
  }

  send(request) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(request));
  }
}
