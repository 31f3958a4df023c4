// The connection to the program: each message has one answer, in order.

export class Talk {
  constructor(token, lost) {
    this.waiting = [];
    this.socket = new WebSocket(`ws://${location.host}/live`);
    this.socket.onopen = () => this.socket.send(JSON.stringify({ type: "token", token }));
    this.open = new Promise((done) => this.waiting.push(done));
    this.socket.onmessage = (event) => this.waiting.shift()?.(JSON.parse(event.data));
    this.socket.onclose = () => lost();
  }

  async ask(message) {
    await this.open;
    const answer = new Promise((done) => this.waiting.push(done));
    this.socket.send(JSON.stringify(message));
    return answer;
  }

  close() {
    this.socket.onclose = null;
    this.socket.close();
  }
}
