/* A machine in the picture: what it has cut of the job, where it is, and whether the reader goes with it. */

const ARROW = 20;

class Machine {
  constructor(view) {
    this.view = view;
    // Where it is, in which direction it moves, radians from X, and in which state it is.
    [this.at, this.heading, this.state] = [null, null, ''];
    // The time of the job goes with the machine, and the picture is fitted until somebody moves it.
    [this.isFollowed, this.isFitted] = [false, true];
    view.scene.live = this;
    view.scene.cut = 0;
    document.querySelector('#kinds .cut').hidden = !view.path.count;
    this.connectFollowing();
    this.connectFitting();
  }

  /** The least and the greatest of where it has been. */
  bounds() {
    return this.at && [this.at, this.at];
  }

  /** It has cut the job up to a time of it, s. */
  cutTo(time) {
    const { view } = this;
    this.leave();
    view.scene.cut = time;
    if (this.isFollowed && time !== view.now) {
      view.setTime(time);
      this.shown = view.now;
    }
  }

  /** Whoever goes to another time leaves the machine. */
  leave() {
    if (this.isFollowed && this.view.now !== this.shown) this.follow(false);
  }

  follow(wants) {
    this.isFollowed = wants;
    this.shown = this.view.now;
    $('follow').setAttribute('aria-pressed', wants);
  }

  /** The button by which the job's time goes with the machine. */
  connectFollowing() {
    const { view } = this;
    const button = element('button', 'Live');
    button.id = 'follow';
    button.title = 'Follow the machine';
    $('transport').prepend(button);
    button.addEventListener('click', () => {
      view.play(false);
      this.follow(true);
      this.cutTo(view.scene.cut);
      view.scene.ask();
    });
    this.follow(this.isFollowed);
  }

  /** Fits the picture until somebody turns or moves it, and again from when it is wanted. */
  connectFitting() {
    ['pointermove', 'wheel', 'keydown'].forEach((name) => $('stage').addEventListener(name, (event) => {
      if (name !== 'pointermove' || event.buttons) this.isFitted = false;
    }));
    const fitted = () => { this.isFitted = true; };
    $('views').addEventListener('click', fitted);
    $('stage').addEventListener('dblclick', fitted);
    document.addEventListener('keydown', ({ key }) => { if ('1234fF'.includes(key)) fitted(); });
  }

  /** Draws all of it with the next frame. */
  ask() {
    const { scene } = this.view;
    if (this.isFitted) scene.fit();
    scene.ask();
  }

  /** Where the machine is, and where it goes. */
  render(scene) {
    this.leave();
    const { at, heading } = this;
    if (!at) return;
    const context = scene.above.getContext('2d');
    const [x, y] = scene.project(at);
    context.fillStyle = scene.marks.colours.point;
    context.beginPath();
    context.arc(x, y, 5, 0, 2 * Math.PI);
    context.fill();
    if (heading === null || !/^(Run|Jog|Home)/.test(this.state)) return;
    const ahead = scene.project([at[0] + Math.cos(heading), at[1] + Math.sin(heading), at[2]]);
    context.save();
    context.translate(x, y);
    context.rotate(Math.atan2(ahead[1] - y, ahead[0] - x));
    context.beginPath();
    context.moveTo(ARROW, 0);
    context.lineTo(7, 6);
    context.lineTo(7, -6);
    context.fill();
    context.restore();
  }
}
