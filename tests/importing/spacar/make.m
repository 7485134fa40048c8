% The input of SPACAR Light that the tests read: run `octave make.m` in this folder. First the guide of the page "Coming from
% SPACAR", word for word; then a cross hinge with an arm, and a cartwheel with wires, releases and words that have no counterpart.
L = 0.1;  W = 0.05;
nodes    = [0 0 0;  0 L 0;  W L 0;  W 0 0];
elements = [1 2;  2 3;  3 4];
clear nprops eprops opt
nprops(1).fix     = true;
nprops(4).fix     = true;
nprops(2).displ_x = 10e-3;
eprops(1).elems  = [1 3];
eprops(1).emod   = 210e9;  eprops(1).smod = 79e9;  eprops(1).dens = 7800;
eprops(1).cshape = 'rect'; eprops(1).dim  = [50e-3 0.5e-3];
eprops(1).orien  = [0 0 1];
eprops(1).nbeams = 4;
eprops(1).flex   = 1:6;
eprops(2).elems  = 2;
eprops(2).dens   = 2700;
eprops(2).cshape = 'rect'; eprops(2).dim  = [50e-3 25e-3];
eprops(2).orien  = [0 0 1];
opt.loadsteps = 5;
save('-v7', 'guide.mat', 'nodes', 'elements', 'nprops', 'eprops', 'opt');

% two crossed leaf springs at different heights, clamps and arm rigid, turned by a moment, with gravity and a payload
h = 0.02;
nodes = [0 0 0;  0.06 0.06 0;  0.06 0 h;  0 0.06 h;  0.03 0.1 h/2];
elements = [1 2;  3 4;  2 4;  4 5;  1 3];
clear nprops eprops opt
nprops(1).fix = 1;
nprops(5).moment = [0 0 0.2];  nprops(5).force_initial = [1 0 0];
nprops(5).mass = 0.3;  nprops(5).mominertia = [1e-4 2e-5 0 2e-4 0 3e-4];
eprops(1).elems = [1 2];  eprops(1).emod = 70e9;  eprops(1).smod = 26e9;  eprops(1).dens = 2700;
eprops(1).cshape = 'rect';  eprops(1).dim = [10e-3 0.4e-3];  eprops(1).orien = [0 0 1];  eprops(1).flex = 1:6;
eprops(1).warping = true;
opt.gravity = [0 -9.81 0];
save('-v7', 'cross.mat', 'nodes', 'elements', 'nprops', 'eprops', 'opt');

% a cartwheel: two leaf springs through one middle, of which the middle is a node without anything
nodes = [-0.02 -0.03 0;  0.02 -0.03 0;  0 0 0;  -0.02 0.03 0;  0.02 0.03 0;  0 0.06 0];
elements = [1 3;  2 3;  3 4;  3 5;  4 5;  5 6];
clear nprops eprops opt
nprops(1).fix = true;  nprops(2).fix = true;
nprops(6).rot_z = 0.1;  nprops(6).rot_initial_z = 0.05;  nprops(6).transfer_in = 1;
eprops(1).elems = 1:4;  eprops(1).emod = 200e9;  eprops(1).smod = 77e9;  eprops(1).cshape = 'rect';
eprops(1).dim = [20e-3 0.3e-3];  eprops(1).orien = [0 0 1];  eprops(1).flex = [1 2 3 4 5 6];
opt.rls(1).def = 1;
save('-v7', 'cartwheel.mat', 'nodes', 'elements', 'nprops', 'eprops', 'opt');
